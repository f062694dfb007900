//! Where the chair goes: how the ground tilts and what drives the chair, as functions of time.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, PI, TAU};

/// Ground that tilts up, stays tilted and becomes flat again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ramp {
    /// Tilt before and after, rad.
    pub base: f64,
    /// Tilt in between, rad.
    pub slope: f64,
    /// Time at which the tilt begins to change, s.
    pub from: f64,
    /// Time at which it begins to change back, s.
    pub to: f64,
    /// Duration of a change (raised cosine), s; 0 = a step, during which nothing rotates.
    pub edge: f64,
}

impl Ramp {
    /// Ground of the same slope everywhere, rad, positive uphill.
    pub fn constant(slope: f64) -> Self {
        Self { base: slope, slope, from: 0.0, to: 0.0, edge: 0.0 }
    }

    /// Tilt, its rate and its second derivative.
    pub fn at(&self, time: f64) -> [f64; 3] {
        let height = self.slope - self.base;
        let up = rise(time - self.from, self.edge);
        let down = rise(time - self.to, self.edge);
        let value = |k: usize| height * (up[k] - down[k]);
        [self.base + value(0), value(1), value(2)]
    }
}

/// From 0 to 1 within `edge` seconds.
fn rise(time: f64, edge: f64) -> [f64; 3] {
    if time < 0.0 {
        [0.0; 3]
    } else if time >= edge {
        [1.0, 0.0, 0.0]
    } else {
        let omega = PI / edge;
        let phase = omega * time;
        [0.5 * (1.0 - phase.cos()), 0.5 * omega * phase.sin(), 0.5 * omega * omega * phase.cos()]
    }
}

/// A drive over a ramp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Course {
    /// Straight up a ramp and down again (heading pi/2).
    Climb,
    /// Onto the ramp at 60 degrees to the contour line; gravity turns the chair downhill.
    Oblique,
    /// Straight up with a moment of 3 N m for half a second.
    YawMoment,
    /// Pushes of all signs and sizes in both directions, for the identification.
    Identification,
}

impl Course {
    /// Heading at the start, rad.
    pub fn heading(self) -> f64 {
        match self {
            Course::Climb | Course::YawMoment => FRAC_PI_2,
            Course::Oblique => FRAC_PI_3,
            Course::Identification => 1.0,
        }
    }

    /// The ground.
    pub fn ramp(self) -> Ramp {
        match self {
            Course::Identification => Ramp::constant(0.05),
            _ => Ramp { base: 0.0, slope: 0.08, from: 2.0, to: 6.0, edge: 0.5 },
        }
    }

    /// How long it takes, s.
    pub fn duration(self) -> f64 {
        match self {
            Course::Identification => 40.0,
            _ => 10.0,
        }
    }

    /// Force, N, and moment, N m, at a time; a user who drives back and forth looks at the speed.
    pub fn command(self, time: f64, speed: f64) -> [f64; 2] {
        let within = |from: f64, to: f64| time >= from - 1e-9 && time < to - 1e-9;
        if self == Course::Identification {
            // Sines without common period: back and forth, with pushes, and turning both ways.
            let wave = |period: f64, phase: f64| (TAU * time / period + phase).sin();
            let wanted = 0.9 * wave(8.3, 0.0);
            let force = (80.0 * (wanted - speed) + 25.0 * wave(1.9, 1.0) + 15.0 * wave(1.1, 2.0)).clamp(-150.0, 150.0);
            let moment = 4.0 * wave(5.3, 0.7) + 3.0 * wave(2.3, 0.2) + 2.0 * wave(1.1, 1.1);
            return [force, moment];
        }
        let force = if within(0.5, 1.5) {
            80.0
        } else if within(1.5, 6.0) {
            50.0
        } else {
            0.0
        };
        let moment = match self {
            Course::YawMoment if within(1.5, 2.0) => 3.0,
            Course::YawMoment if within(6.5, 7.0) => -3.0,
            _ => 0.0,
        };
        [force, moment]
    }
}
