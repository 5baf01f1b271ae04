//! Images over the air, in a program that a boot loader has started.

use super::boot_state::BootState;
use super::flash::Flash;
use super::image_flash::{Room, State};
use firmware::image_store::ImageStore;
use firmware::link::{ImageStatus, UpdateAnswer, UpdateFrame};
use firmware::table_store::{Key, TableStore};

/// The image's version: a number in the environment of the build, counted up; 0 without it.
const VERSION: u32 = match option_env!("FRESHLANE_IMAGE_VERSION") {
    None => 0,
    Some(text) => match u32::from_str_radix(text, 10) {
        Ok(version) => version,
        Err(_) => panic!("FRESHLANE_IMAGE_VERSION: expected a number up to 4294967294"),
    },
};

/// Says in the image which version it is, to whoever signs it.
#[used]
static IMAGE_VERSION: u32 = VERSION;

/// The room of the next image. Without a boot loader it is none, and nothing of it is in the program.
pub struct Images(Option<ImageStore<Room, BootState<State>>>);

impl Images {
    /// As at a start.
    #[allow(unsafe_code, reason = "several parts of the flash share one controller")]
    pub fn boot() -> Self {
        Self(crate::IS_RENEWABLE.then(|| {
            // SAFETY: the table store is the only other one that works with the controller, and both do so in `idle` alone. The sectors
            // hold nothing that is borrowed.
            let (room, state) = unsafe { (Room::new(), BootState(State::new())) };
            ImageStore::boot(room, state, Key::BUILT_IN, VERSION)
        }))
    }

    fn store(&mut self) -> Option<&mut ImageStore<Room, BootState<State>>> {
        // Known to the compiler, as the option in a static place is not.
        self.0.as_mut().filter(|_| crate::IS_RENEWABLE)
    }

    /// One step of an update, of the table or of the image.
    pub fn step(&mut self, tables: &mut TableStore<Flash>, step: &UpdateFrame) -> UpdateAnswer {
        if let Some(images) = self.store() {
            if images.concerns(step) {
                return images.step(step);
            }
            images.abandon();
        }
        tables.step(step)
    }

    /// The unit has decided for a whole window.
    pub fn prove(&mut self) {
        if let Some(images) = self.store() {
            images.prove();
        }
    }

    /// What there is to say of the running image.
    pub fn status(&mut self) -> ImageStatus {
        ImageStatus {
            version: VERSION,
            on_trial: self.store().is_some_and(|images| images.is_on_trial()),
        }
    }
}
