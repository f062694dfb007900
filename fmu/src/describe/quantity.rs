//! What a unit measures, and how large such a value usually is in a machine that carries people or loads.

/// Unit, quantity in the names of the Modelica Standard Library (`Modelica.Units.SI`), usual magnitude.
const QUANTITIES: [(&str, &str, f64); 22] = [
    ("kg", "Mass", 100.0),
    ("m", "Length", 1.0),
    ("s", "Time", 1.0),
    ("Hz", "Frequency", 1.0),
    ("rad", "Angle", 0.1),
    ("rad/s", "AngularVelocity", 1.0),
    ("rad/s2", "AngularAcceleration", 1.0),
    ("m/s", "Velocity", 1.0),
    ("m/s2", "Acceleration", 1.0),
    ("N", "Force", 100.0),
    ("N.m", "Torque", 10.0),
    ("W", "Power", 100.0),
    ("K", "ThermodynamicTemperature", 300.0),
    ("m2", "Area", 1.0),
    ("kg/m3", "Density", 1.0),
    ("kg.m2", "MomentOfInertia", 1.0),
    ("N/m", "TranslationalSpringConstant", 1e5),
    ("N.s/m", "TranslationalDampingConstant", 100.0),
    ("N.m/rad", "RotationalSpringConstant", 100.0),
    ("N.m.s/rad", "RotationalDampingConstant", 10.0),
    ("Pa", "Pressure", 1e5),
    ("J", "Energy", 100.0),
];

/// Name of the quantity with this unit, if it has one.
pub fn name(unit: &str) -> Option<&'static str> {
    QUANTITIES.iter().find(|(known, ..)| *known == unit).map(|(_, name, _)| *name)
}

/// Usual magnitude of a value: that of its start, or else of its unit.
pub fn nominal(unit: &str, start: f64) -> f64 {
    if (1e-9..=1e9).contains(&start.abs()) {
        return start.abs();
    }
    QUANTITIES.iter().find(|(known, ..)| *known == unit).map_or(1.0, |(.., size)| *size)
}
