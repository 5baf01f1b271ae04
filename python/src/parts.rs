//! Environments beside the setting that they borrow from, so that Python can hold and copy both as one.

#![expect(unsafe_code, reason = "environments that borrow from what lies beside them")]

use crate::scenario::Setting;
use host_sim::environment::Environment;
use kit::error::Result;
use std::sync::Arc;

/// The environments of a batch, one a part, and what their worlds are made of.
pub struct Parts {
    /// Really of the setting's lifetime. Declared, and so dropped, before it.
    environments: Vec<Environment<'static>>,
    setting: Arc<Setting>,
}

impl Parts {
    /// Keeps a setting and opens environments in it.
    pub fn new(setting: Setting, open: impl for<'s> FnOnce(&'s Setting) -> Vec<Environment<'s>>) -> Self {
        let setting = Arc::new(setting);
        // SAFETY: the setting lies behind an `Arc` that lives as long as the environments: in this struct beside them and, behind
        // the same `Arc`, beside their copies. It is never changed. No environment leaves: `with` and `new` let callers see one
        // only under a lifetime of which they know nothing, and `environments` under that of the struct.
        let borrowed: &'static Setting = unsafe { &*Arc::as_ptr(&setting) };
        Self {
            environments: open(borrowed),
            setting,
        }
    }

    /// What the worlds are made of.
    pub fn setting(&self) -> &Setting {
        &self.setting
    }

    /// The environments.
    pub fn environments(&self) -> &[Environment<'_>] {
        &self.environments
    }

    /// Lets somebody change the environments.
    pub fn with<R>(&mut self, work: impl for<'s> FnOnce(&'s Setting, &mut [Environment<'s>]) -> R) -> R {
        // SAFETY: as in `new`.
        let borrowed: &'static Setting = unsafe { &*Arc::as_ptr(&self.setting) };
        work(borrowed, &mut self.environments)
    }

    /// Environments in the same state, which go on by themselves.
    ///
    /// # Errors
    /// Where an outside program moves vehicles.
    pub fn copy(&self) -> Result<Self> {
        let copies = self.environments.iter().map(Environment::copy);
        Ok(Self {
            environments: copies.collect::<Result<_>>()?,
            setting: Arc::clone(&self.setting),
        })
    }
}
