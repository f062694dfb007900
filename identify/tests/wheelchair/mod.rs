//! The wheelchair.

mod fit;
