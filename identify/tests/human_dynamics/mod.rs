//! The human body.

mod end_to_end;
mod recordings;
