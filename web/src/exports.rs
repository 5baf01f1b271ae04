//! What JavaScript calls. Text goes in and out through one buffer of the instance; views are addresses of arrays in its memory
//! ([`crate::session`] and [`crate::town`] have their layouts), good until the next call.
//!
//! Without a session every call does nothing: lengths are 0 and answers are `false`.
#![expect(
    unsafe_code,
    reason = "a name that JavaScript can call has to be exported unmangled; all of them begin with `cell_` or `town_`, and nothing else here is unsafe"
)]

use crate::session::{Request, Session};
use crate::town::{Pictures, TownRequest, TownSession};
use kit::error::{Error, Result};
use std::cell::RefCell;

#[derive(Default)]
struct Instance {
    text: Vec<u8>,
    session: Option<Session>,
    town: Option<TownSession>,
}

thread_local! {
    static INSTANCE: RefCell<Instance> = RefCell::default();
}

/// Makes room for a text of this many bytes, which the caller writes.
#[unsafe(no_mangle)]
pub extern "C" fn cell_text(length: usize) -> *mut u8 {
    INSTANCE.with_borrow_mut(|instance| {
        instance.text.clear();
        instance.text.resize(length, 0);
        instance.text.as_mut_ptr()
    })
}

/// Address of the text of the last answer.
#[unsafe(no_mangle)]
pub extern "C" fn cell_answer() -> *const u8 {
    INSTANCE.with_borrow(|instance| instance.text.as_ptr())
}

/// Bytes of the text of the last answer.
#[unsafe(no_mangle)]
pub extern "C" fn cell_answer_length() -> usize {
    INSTANCE.with_borrow(|instance| instance.text.len())
}

/// The sources that this program was built from, as text.
#[unsafe(no_mangle)]
pub extern "C" fn cell_sources() {
    INSTANCE.with_borrow_mut(|instance| instance.text = crate::SOURCES.into());
}

/// Opens the world that the text asks for ([`Request`] as JSON). The answer's text describes it
/// ([`Session::description`]), or says in one line what does not fit; the session before then goes on.
#[unsafe(no_mangle)]
pub extern "C" fn cell_open() -> bool {
    answer(|instance| {
        let request: Request = serde_json::from_slice(&instance.text)
            .map_err(|error| Error::input("request", error, "a world to open"))?;
        let session = Session::open(&request)?;
        let description = session.description().to_string();
        instance.session = Some(session);
        Ok(description)
    })
}

/// Lets the policy of the text's name decide; if it cannot, the answer's text says why.
#[unsafe(no_mangle)]
pub extern "C" fn cell_set_policy() -> bool {
    answer(|instance| {
        let name = String::from_utf8_lossy(&instance.text).into_owned();
        if let Some(session) = &mut instance.session {
            session.set_policy(&name)?;
        }
        Ok(name)
    })
}

/// [`Session::advance`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_advance(slots: u32) {
    with_session((), |session| session.advance(slots));
}

/// [`Session::jam`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_jam(vehicle: usize, jam: bool) -> bool {
    with_session(false, |session| session.jam(vehicle, jam))
}

/// [`Session::join`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_join(x_m: f64, y_m: f64) -> bool {
    with_session(false, |session| session.join(x_m, y_m))
}

/// [`Session::elapsed`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_elapsed() -> u32 {
    with_session(0, |session| session.elapsed())
}

/// [`Session::count_from`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_count_from() -> u32 {
    with_session(0, |session| session.count_from())
}

/// [`Session::vehicle_count`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_vehicle_count() -> usize {
    with_session(0, |session| session.vehicle_count())
}

/// [`Session::bound_age_ms`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_bound_age_ms() -> f64 {
    with_session(f64::NAN, |session| session.bound_age_ms())
}

/// Address of [`Session::vehicles`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_vehicles() -> *const f32 {
    with_session(std::ptr::null(), |session| session.vehicles().as_ptr())
}

/// Address of [`Session::occupancy`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_occupancy() -> *const u8 {
    with_session(std::ptr::null(), |session| session.occupancy().as_ptr())
}

/// Address of [`Session::history_ms`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_history_ms(run: usize) -> *const f32 {
    with_session(std::ptr::null(), |session| session.history_ms(run).as_ptr())
}

/// Address of [`Session::summaries`].
#[unsafe(no_mangle)]
pub extern "C" fn cell_summaries() -> *const f64 {
    with_session(std::ptr::null(), |session| session.summaries().as_ptr())
}

/// Runs the town that the text asks for ([`TownRequest`] as JSON) to its end. The answer's text describes it
/// ([`TownSession::description`]), or says in one line what does not fit.
#[unsafe(no_mangle)]
pub extern "C" fn town_open() -> bool {
    answer(|instance| {
        let request: TownRequest = serde_json::from_slice(&instance.text)
            .map_err(|error| Error::input("request", error, "a town to open"))?;
        let town = TownSession::open(&request)?;
        let description = town.description().to_string();
        instance.town = Some(town);
        Ok(description)
    })
}

/// Address of [`Pictures::starts`] of a side.
#[unsafe(no_mangle)]
pub extern "C" fn town_starts(side: usize) -> *const u32 {
    with_pictures(std::ptr::null(), side, |pictures| pictures.starts().as_ptr())
}

/// Address of [`Pictures::numbers`] of a side.
#[unsafe(no_mangle)]
pub extern "C" fn town_numbers(side: usize) -> *const f32 {
    with_pictures(std::ptr::null(), side, |pictures| pictures.numbers().as_ptr())
}

fn with_pictures<T>(without: T, side: usize, work: impl FnOnce(&Pictures) -> T) -> T {
    INSTANCE.with_borrow(|instance| {
        let pictures = instance.town.as_ref().and_then(|town| town.side(side));
        pictures.map_or(without, work)
    })
}

fn with_session<T>(without: T, work: impl FnOnce(&mut Session) -> T) -> T {
    INSTANCE.with_borrow_mut(|instance| instance.session.as_mut().map_or(without, work))
}

fn answer(work: impl FnOnce(&mut Instance) -> Result<String>) -> bool {
    INSTANCE.with_borrow_mut(|instance| {
        let outcome = work(instance);
        let good = outcome.is_ok();
        instance.text = outcome.unwrap_or_else(|error| error.to_string()).into_bytes();
        good
    })
}
