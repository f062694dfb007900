//! The filters by themselves, without a machine.

mod cubature;
mod map;
mod rls;
mod sliding_mode;
mod square_root;
mod unscented;
