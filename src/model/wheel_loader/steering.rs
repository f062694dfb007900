//! Paths of the axles in a bend, from the steering angle.
//!
//! An axle rolls along its own wheels. *Front-steered*: the front axle turned by `delta` rolls `v_f = v_r / cos delta`
//! where the rear one rolls `v_r`. *Articulated*: two halves meet at a joint that lies `l_f` behind the front and `l_r`
//! forward of the rear axle; `gamma` is the front half's heading minus the rear half's. The joint has one velocity, and
//! neither axle moves sideways:
//!
//! ```text
//! v_f cos gamma + l_f w_f sin gamma = v_r       w_f = w_r + gamma'
//! v_f sin gamma - l_f w_f cos gamma = l_r w_r
//! v_f (l_f + l_r cos gamma) = v_r (l_r + l_f cos gamma) - l_f l_r gamma' sin gamma
//! ```
//!
//! With the joint halfway both axles roll equally far in a steady bend; while the angle changes they do not.

use super::Loader;

choice! {
    /// How a machine is steered, as far as its steering angle is measured.
    pub enum Steering { None = "none", Articulated = "articulated", FrontSteered = "front_steered" }
}

/// Rear axle's speed as a function of the front axle's, `v_r = gain v_f + offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Paths {
    /// Dimensionless.
    pub gain: f64,
    /// Derivative of the gain to the angle, 1/rad.
    pub gain_by_angle: f64,
    /// m/s.
    pub offset: f64,
}

impl Loader {
    /// The axles' paths at a steering angle (rad) that changes at `rate` (rad/s).
    pub fn paths(&self, angle: f64, rate: f64) -> Paths {
        let (sin, cos) = angle.sin_cos();
        match self.steering {
            Steering::None => Paths { gain: 1.0, gain_by_angle: 0.0, offset: 0.0 },
            Steering::FrontSteered => Paths { gain: cos, gain_by_angle: -sin, offset: 0.0 },
            Steering::Articulated => {
                let front = self.joint_to_front_axle;
                let rear = self.wheelbase - front;
                // Positive: below a right angle, and with the joint between the axles.
                let (above, below) = (front + rear * cos, rear + front * cos);
                Paths {
                    gain: above / below,
                    gain_by_angle: sin * (front * front - rear * rear) / (below * below),
                    offset: front * rear * rate * sin / below,
                }
            }
        }
    }
}
