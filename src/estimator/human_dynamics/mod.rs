//! Human dynamics: joint torques, contact wrenches and their variances from posture and sensors.
//!
//! [`WholeBody`](whole_body::WholeBody) works on any tree.

pub mod whole_body;
