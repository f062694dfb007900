//! The filters by themselves, without a machine.

mod cubature;
mod square_root;
