//! What people and scripts read: tables, figures, files.

pub mod files;
