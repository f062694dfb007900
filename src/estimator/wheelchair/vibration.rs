//! Vibration of the accelerometer, as on cobbles: noise beyond its own.
//!
//! Vibration is broadband and a wrong bias, force or slope is not, so it is recognised by how far
//! innovations of neighbouring samples lie apart. With `D_k = E[(nu_t - nu_(t-k))^2]/2`, less the accelerometer's own noise, and
//! vibration that is left after a sample to a share `c`, `D_1 = V (1 - c)` and `D_2 = V (1 - c^2)`: `c = D_2/D_1 - 1`.
//! A filter that takes its noise for white needs the variance of white noise with the same mean over many samples,
//! `V (1 + c)/(1 - c) = D_1 (1 + c)/(1 - c)^2`. An onset counts at once: what vibration makes of force, bias and slope within the
//! first samples, before it is known of, stays for the rest of the ride. It shows `D_1` in some samples and `c` not before some dozens:
//! so long a large share is taken to be left. The source has nothing of the kind.

use super::outliers::{ACCEL_X, DIVERGED};
use crate::filter::ekf::Rows;
use serde::{Deserialize, Serialize};

/// Time over which the differences are averaged, s.
const TIME: f64 = 0.5;
/// A difference squared counts at most as so many times the present mean: an impact is no vibration. Where the forward
/// accelerometer drives the motion an impact does harm for no longer than it lasts, and vibration at once.
pub(super) const LARGEST: f64 = 12.0;
pub(super) const LARGEST_DRIVEN: f64 = 25.0;
/// Below the first ratio of `D_1` to the accelerometer's noise there is no vibration, from the second on all of it counts.
const FELT: (f64, f64) = (1.5, 2.5);
/// Time over which the share `c` is averaged, s, if the shorter one does not show more of it: `c` is a small difference.
const COLOUR: f64 = 3.0;
/// An onset is noticed over this time, s, if `D_1` is beyond `SUDDEN` times the accelerometer's variance, which its own noise
/// does not reach. What is not counted until the long mean has followed has moved the slope by then, or the force's gain.
const ONSET: f64 = 0.04;
const SUDDEN: f64 = 5.0;
/// The share that counts until both are averaged.
const UNKNOWN: f64 = 0.7;
/// The largest share that vibration keeps after a sample.
const SLOWEST: f64 = 0.8;
/// `D_2/D_1` is at most 2 for what has any such share, and 4 for motion, which is smooth: up to the first ratio it counts
/// in full, from the second on not at all.
const MOTION: (f64, f64) = (2.2, 3.2);

/// One axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Axis {
    /// The last innovations, and how many of the last two samples there were.
    last: [f64; 2],
    samples: u8,
    /// `D_1` and `D_2` with the accelerometer's own noise, (m/s^2)^2, over `TIME`, and over `COLOUR`.
    apart: [f64; 2],
    colour: [f64; 2],
    /// `D_1` over `ONSET`.
    sudden: f64,
    /// For how long it has been beyond what the accelerometer's own noise reaches, s, less the time without since then.
    lasts: f64,
}

impl Axis {
    /// Takes an innovation; `noise` is the accelerometer's variance. The shares of a sample in the means are those of
    /// `TIME`, `COLOUR` and `ONSET`, and a difference squared counts in the first two as at most `largest` times the mean.
    fn learn(&mut self, innovation: f64, noise: f64, [share, colour, sudden]: [f64; 3], largest: f64) {
        let most = largest * (self.apart[0] + noise);
        for k in 0..usize::from(self.samples) {
            let difference = innovation - self.last[k];
            let half = 0.5 * difference * difference;
            self.apart[k] += share * (half.min(most) - self.apart[k]);
            self.colour[k] += colour * (half.min(most) - self.colour[k]);
            if k == 0 {
                self.sudden += sudden * (half - self.sudden);
            }
        }
        self.last = [innovation, self.last[0]];
        self.samples = (self.samples + 1).min(2);
    }

    /// [`variance`](Self::variance), or what an onset shows if it is more, `dt` seconds after the sample before.
    fn with_onset(&mut self, noise: f64, dt: f64) -> f64 {
        let variance = self.variance(noise);
        if self.sudden <= SUDDEN * noise {
            self.lasts = (self.lasts - dt).max(0.0);
            return variance;
        }
        self.lasts = (self.lasts + dt).min(TIME);
        let kept = if self.lasts < TIME { UNKNOWN } else { 0.0 };
        variance.max(white(self.sudden - noise, kept))
    }

    /// Variance of white noise that does what the vibration does, (m/s^2)^2.
    fn variance(&self, noise: f64) -> f64 {
        let felt = ((self.apart[0] / noise - FELT.0) / (FELT.1 - FELT.0)).clamp(0.0, 1.0);
        if felt == 0.0 {
            return 0.0;
        }
        let neighbours = self.apart[0] - noise;
        let ratio = (self.apart[1] - noise) / neighbours;
        let broadband = ((MOTION.1 - ratio) / (MOTION.1 - MOTION.0)).clamp(0.0, 1.0);
        let longer = (self.colour[1] - noise) / (self.colour[0] - noise).max(noise);
        let kept = (longer.max(ratio) - 1.0).clamp(0.0, SLOWEST);
        felt * broadband * white(neighbours, kept)
    }
}

/// Variance of white noise with the mean of noise of which the share `kept` is left after a sample, from its `D_1`.
fn white(apart: f64, kept: f64) -> f64 {
    apart * (1.0 + kept) / ((1.0 - kept) * (1.0 - kept))
}

/// The vibration of the three axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vibration {
    axes: [Axis; 3],
    /// Its forward variance beside the accelerometer's own noise, (m/s^2)^2.
    pub forward: f64,
}

impl Vibration {
    /// Takes the innovations of a sample that came `dt` seconds after the last one and adds the vibration to the
    /// noise of the accelerometer's rows; `own` is the variance of the accelerometer alone. A gate is to see the first samples of
    /// an onset as they are: they may as well be outliers.
    pub(super) fn add<const N: usize>(&mut self, rows: &mut Rows<N, 6>, own: f64, dt: f64, largest: f64, gated: bool) {
        let shares = [TIME, COLOUR, ONSET].map(|time| 1.0 - (-dt / time).exp());
        for (k, axis) in self.axes.iter_mut().enumerate() {
            let row = ACCEL_X + k;
            // What is further off is a filter that has diverged.
            let innovation = rows.innovation[row];
            if innovation.is_nan() || innovation.abs() >= DIVERGED {
                axis.samples = 0;
                continue;
            }
            axis.learn(innovation, own, shares, largest);
            let (lasting, variance) = (axis.variance(own), axis.with_onset(own, dt));
            rows.noise[(row, row)] += if gated { lasting } else { variance };
            if k == 0 {
                self.forward = variance;
            }
        }
    }
}
