//! Road elevation after ISO 8608: a sum of harmonics whose phases come from outside.

/// One road: elevation and slope over the distance, tabulated once.
#[derive(Clone, Debug)]
pub struct Road {
    spacing: f64,
    /// Elevation, m, and its derivative, at multiples of the spacing.
    points: Vec<(f64, f64)>,
}

/// Displacement spectral density at 0.1 cycle/m, m3, for the classes of ISO 8608 (geometric means).
pub mod class {
    /// Very good.
    pub const A: f64 = 16e-6;
    /// Good.
    pub const B: f64 = 64e-6;
    /// Average.
    pub const C: f64 = 256e-6;
    /// Poor.
    pub const D: f64 = 1024e-6;
}

impl Road {
    /// No elevation.
    pub fn flat() -> Self {
        Self { spacing: 1.0, points: vec![(0.0, 0.0); 2] }
    }

    /// `G_d(n) = roughness (n / 0.1)^-2` over `n` = 0.02 to 3 cycle/m with one harmonic per phase
    /// (rad), log-spaced; a contact of length `contact` (m) averages it. Covers `-10 m ..= length`;
    /// outside it goes on level.
    pub fn iso8608(roughness: f64, phases: &[f64], contact: f64, length: f64) -> Self {
        let (low, high): (f64, f64) = (0.02, 3.0);
        let ratio = (high / low).powf(1.0 / phases.len().max(1) as f64);
        let harmonics: Vec<(f64, f64, f64)> = phases
            .iter()
            .enumerate()
            .map(|(i, phase)| {
                let from = low * ratio.powi(i as i32);
                let n = from * ratio.sqrt();
                let density = roughness * (n / 0.1).powi(-2);
                let amplitude = (2.0 * density * from * (ratio - 1.0)).sqrt();
                let half = std::f64::consts::PI * n * contact;
                let averaged = if half > 0.0 { amplitude * half.sin() / half } else { amplitude };
                (averaged, std::f64::consts::TAU * n, *phase)
            })
            .collect();
        let spacing = 0.05;
        let count = ((length.max(1.0) + MARGIN) / spacing).ceil() as usize + 2;
        let mut points = vec![(0.0, 0.0); count];
        for (amplitude, wave, phase) in harmonics {
            // Each harmonic walks along the road by rotation instead of a sine per point.
            let (mut sin, mut cos) = (phase - wave * MARGIN).sin_cos();
            let (turn_sin, turn_cos) = (wave * spacing).sin_cos();
            for (elevation, slope) in &mut points {
                *elevation += amplitude * sin;
                *slope += amplitude * wave * cos;
                (sin, cos) = (sin * turn_cos + cos * turn_sin, cos * turn_cos - sin * turn_sin);
            }
        }
        Self { spacing, points }
    }

    /// Elevation, m, and slope at distance `x`: cubic between the tabulated points.
    pub fn at(&self, x: f64) -> (f64, f64) {
        let position = (x + MARGIN) / self.spacing;
        let last = self.points.len() - 2;
        if position < 0.0 || position.is_nan() {
            return (self.points[0].0, 0.0);
        }
        let k = position.floor();
        if k >= last as f64 {
            return (self.points[last].0, 0.0);
        }
        let t = position - k;
        let ((y0, s0), (y1, s1)) = (self.points[k as usize], self.points[k as usize + 1]);
        let (m0, m1) = (s0 * self.spacing, s1 * self.spacing);
        let rise = y1 - y0;
        let (c2, c3) = (3.0 * rise - 2.0 * m0 - m1, m0 + m1 - 2.0 * rise);
        let elevation = y0 + t * (m0 + t * (c2 + t * c3));
        let slope = (m0 + t * (2.0 * c2 + 3.0 * t * c3)) / self.spacing;
        (elevation, slope)
    }
}

/// The road begins this far behind the start, m, for axles behind the centre of gravity.
const MARGIN: f64 = 10.0;
