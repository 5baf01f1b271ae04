//! Static traffic assignment.
