//! The filters by themselves, without a machine.

mod cubature;
mod rls;
mod square_root;
mod unscented;
