//! The page in a real browser: a file server on the loopback interface and a headless Chromium that looks at it.

use headless_chrome::protocol::cdp::types::Event;
use headless_chrome::protocol::cdp::{Emulation, Network, Performance};
use headless_chrome::{Browser, LaunchOptions, Tab};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How long the page may take for something that it does in well under a second on an idle machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// Serves the files of a folder, as the plainest file server does, for as long as the test runs.
///
/// # Panics
/// If there is no loopback interface.
pub fn serve(folder: PathBuf) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let folder = folder.clone();
            // The browser may close a connection whenever it likes.
            std::thread::spawn(move || answer(&stream, &folder));
        }
    });
    address
}

/// Answers one request and closes.
fn answer(mut stream: &TcpStream, folder: &Path) -> std::io::Result<()> {
    let mut lines = BufReader::new(stream).lines();
    let request = lines.next().transpose()?.unwrap_or_default();
    while lines.next().transpose()?.is_some_and(|line| !line.is_empty()) {}
    let path = request.split(' ').nth(1).unwrap_or("/").trim_start_matches('/');
    let name = if path.is_empty() { "index.html" } else { path };
    let kind = match name.rsplit('.').next() {
        Some("html") => "text/html",
        Some("css") => "text/css",
        Some("js") => "text/javascript",
        _ => "application/octet-stream",
    };
    // Files of the folder itself, and none elsewhere.
    let contents = (!name.contains('/')).then(|| std::fs::read(folder.join(name)));
    let (status, body) = match contents {
        Some(Ok(body)) => ("200 OK", body),
        _ => ("404 Not Found", Vec::new()),
    };
    let length = body.len();
    write!(
        stream,
        "HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n"
    )?;
    stream.write_all(&body)
}

/// A page in a browser. Dropping it ends the browser.
pub struct Page {
    tab: Arc<Tab>,
    complaints: Arc<Mutex<Vec<String>>>,
    requests: Arc<Mutex<Vec<String>>>,
    _browser: Browser,
}

impl Page {
    /// Opens an address in a window of this size.
    ///
    /// # Panics
    /// If there is no Chromium, or if it does not start: a check that cannot run has failed.
    pub fn open(address: &str, window: (u32, u32)) -> Self {
        let options = LaunchOptions::default_builder()
            // Root, whom continuous integration often is, has no sandbox.
            .sandbox(false)
            .window_size(Some(window))
            .idle_browser_timeout(Duration::from_secs(300))
            .build()
            .unwrap();
        let browser = Browser::new(options)
            .unwrap_or_else(|error| panic!("Chromium does not start (./test installs it): {error}"));
        let tab = browser.new_tab().unwrap();
        tab.set_default_timeout(PATIENCE);
        let page = Self {
            tab,
            complaints: Arc::default(),
            requests: Arc::default(),
            _browser: browser,
        };
        page.listen();
        let _ = page.tab.navigate_to(address).unwrap();
        // Asked of the page itself: the event that tells of it may come before anybody waits for it.
        let begin = Instant::now();
        let loaded = "location.protocol == 'http:' && document.readyState == 'complete'";
        while !page.try_evaluate(loaded) {
            assert!(begin.elapsed() < PATIENCE, "{address} never loads");
            std::thread::sleep(Duration::from_millis(20));
        }
        page
    }

    /// Whether a JavaScript expression is true; `false` too while one page takes another's place.
    fn try_evaluate(&self, expression: &str) -> bool {
        let answer = self.tab.evaluate(expression, false);
        answer.is_ok_and(|object| object.value == Some(Value::Bool(true)))
    }

    /// Notes what the page requests, and all that its console shows.
    fn listen(&self) {
        let (complaints, requests) = (self.complaints.clone(), self.requests.clone());
        let note = move |event: &Event| {
            let complaint = match event {
                Event::RuntimeConsoleAPICalled(event) => format!("{:?}", event.params),
                Event::RuntimeExceptionThrown(event) => format!("{:?}", event.params),
                Event::LogEntryAdded(event) => format!("{:?}", event.params),
                Event::NetworkRequestWillBeSent(event) => {
                    requests.lock().unwrap().push(event.params.request.url.clone());
                    return;
                }
                _ => return,
            };
            complaints.lock().unwrap().push(complaint);
        };
        self.tab.enable_log().unwrap().enable_runtime().unwrap();
        self.tab
            .call_method(Network::Enable {
                max_total_buffer_size: None,
                max_resource_buffer_size: None,
                max_post_data_size: None,
                report_direct_socket_traffic: None,
                enable_durable_messages: None,
            })
            .unwrap();
        let _ = self.tab.add_event_listener(Arc::new(note)).unwrap();
    }

    /// Value of a JavaScript expression; of what it promises, if it is a promise.
    ///
    /// # Panics
    /// If the expression fails.
    pub fn value(&self, expression: &str) -> Value {
        // JSON keeps every number's digits.
        let text = format!("(async () => JSON.stringify(await ({expression})) ?? 'null')()");
        let answer = self.tab.evaluate(&text, true);
        let object = answer.unwrap_or_else(|error| panic!("{expression}: {error}"));
        let text = object
            .value
            .unwrap_or_else(|| panic!("{expression}: {:?}", object.description));
        serde_json::from_str(text.as_str().unwrap()).unwrap()
    }

    /// Waits until a JavaScript expression is true.
    ///
    /// # Panics
    /// If it never is.
    pub fn wait_for(&self, expression: &str) {
        let begin = Instant::now();
        while self.value(&format!("Boolean({expression})")) != Value::Bool(true) {
            assert!(
                begin.elapsed() < PATIENCE,
                "never: {expression}\n{:?}",
                self.complaints()
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Gives a control a value, as a visitor does.
    pub fn set(&self, control: &str, value: &str) {
        let _ = self.value(&format!(
            "((control) => {{ control.value = '{value}'; control.dispatchEvent(new Event('input')); \
             control.dispatchEvent(new Event('change')); }})(document.getElementById('{control}'))"
        ));
    }

    /// Shows the page as a medium, `screen` or `print`, to a reader who prefers a colour scheme, `light` or `dark`.
    ///
    /// # Panics
    /// If the browser is gone.
    pub fn show_as(&self, medium: &str, colour_scheme: &str) {
        let preference = Emulation::MediaFeature {
            name: "prefers-color-scheme".to_owned(),
            value: colour_scheme.to_owned(),
        };
        let _ = self
            .tab
            .call_method(Emulation::SetEmulatedMedia {
                media: Some(medium.to_owned()),
                features: Some(vec![preference]),
            })
            .unwrap();
    }

    /// Shows the page to a reader who asks that nothing moves.
    ///
    /// # Panics
    /// If the browser is gone.
    pub fn keep_still(&self) {
        let preference = Emulation::MediaFeature {
            name: "prefers-reduced-motion".to_owned(),
            value: "reduce".to_owned(),
        };
        let _ = self
            .tab
            .call_method(Emulation::SetEmulatedMedia {
                media: None,
                features: Some(vec![preference]),
            })
            .unwrap();
    }

    /// Gives the page this width in CSS pixels, also one that no window has.
    ///
    /// # Panics
    /// If the browser is gone.
    pub fn narrow_to(&self, width_px: u32) {
        let _ = self
            .tab
            .call_method(Emulation::SetDeviceMetricsOverride {
                width: width_px,
                height: 800,
                device_scale_factor: 1.0,
                mobile: false,
                scale: None,
                screen_width: None,
                screen_height: None,
                position_x: None,
                position_y: None,
                dont_set_visible_size: None,
                screen_orientation: None,
                viewport: None,
                display_feature: None,
                device_posture: None,
            })
            .unwrap();
    }

    /// Presses a key with the focus where it is.
    ///
    /// # Panics
    /// If there is no such key.
    pub fn press(&self, key: &str) {
        let _ = self.tab.press_key(key).unwrap();
    }

    /// Clicks a point of the page, in CSS pixels.
    ///
    /// # Panics
    /// If the browser is gone.
    pub fn click(&self, x: f64, y: f64) {
        let _ = self
            .tab
            .click_point(headless_chrome::browser::tab::point::Point { x, y })
            .unwrap();
    }

    /// Processor time of the page's own thread for each frame, in ms, over `frames` frames. Unlike their rate it does not depend on
    /// what else the machine does.
    ///
    /// # Panics
    /// If the browser is gone.
    pub fn milliseconds_per_frame(&self, frames: u32) -> f64 {
        let seconds = || {
            let metrics = self
                .tab
                .call_method(Performance::GetMetrics(None))
                .unwrap()
                .metrics;
            let tasks = metrics.into_iter().find(|metric| metric.name == "TaskDuration");
            tasks.unwrap_or_else(|| panic!("no duration of tasks")).value
        };
        let time_domain = Some(Performance::EnableTime_domainOption::ThreadTicks);
        let _ = self.tab.call_method(Performance::Enable { time_domain }).unwrap();
        let before = seconds();
        let _ = self.value(&format!(
            "new Promise((done) => {{ let left = {frames}; \
             const next = () => {{ left -= 1; if (left > 0) requestAnimationFrame(next); else done(); }}; \
             requestAnimationFrame(next); }})"
        ));
        1000.0 * (seconds() - before) / f64::from(frames)
    }

    /// All that the console has shown so far.
    pub fn complaints(&self) -> Vec<String> {
        self.complaints.lock().unwrap().clone()
    }

    /// All addresses that were requested so far.
    pub fn requests(&self) -> Vec<String> {
        self.requests.lock().unwrap().clone()
    }
}
