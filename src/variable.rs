//! One declaration per variable: name, unit, start, range and meaning stand once.
//!
//! [`variables!`](crate::variables) turns a declaration into a plain struct, and the same
//! declaration feeds the FMU's `modelDescription.xml`, the parameter files, the README tables and
//! the range checks. A field whose type is itself a declared struct is a *group*: its variables are
//! named `group.variable` outside and reached as `group.variable` in Rust.
//!
//! ```
//! use wheelstate::{Variables, choice, variables};
//!
//! choice! {
//!     /// How old samples are forgotten.
//!     pub enum Law { Fixed = "fixed", Threshold = "threshold" }
//! }
//!
//! variables! {
//!     /// The machine.
//!     pub struct Machine {
//!         /// Mass without load.
//!         mass: f64 = 160.0, "kg", [1.0, 1e5];
//!     }
//! }
//!
//! variables! {
//!     /// All parameters.
//!     pub struct Parameters {
//!         /// The machine.
//!         machine: Machine;
//!         /// How old samples are forgotten.
//!         law: Law = Law::Fixed, "1", tunable;
//!     }
//! }
//!
//! let declared = Parameters::declare();
//! assert_eq!(declared[0].name, "machine.mass");
//! assert_eq!(declared[0].description, "Mass without load.");
//! let mut parameters = Parameters::default();
//! parameters.machine.mass = -1.0;
//! let error = parameters.validate().unwrap_err();
//! assert_eq!(error.to_string(), "machine.mass = -1 kg is outside the allowed range 1..=100000 kg");
//! ```

use serde::{Deserialize, Serialize};
use std::borrow::Cow;

/// What a value may be. Every value travels as an `f64` between the estimators and the outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A real number.
    Real,
    /// A whole number.
    Integer,
    /// 0 or 1.
    Boolean,
    /// One of the named choices; the value is the index in this list, from 0.
    Choice(&'static [&'static str]),
    /// A whole number that stands for a condition: number, word and meaning of each.
    Code(&'static [(i32, &'static str, &'static str)]),
}

/// The declaration of one variable.
#[derive(Clone, Debug, PartialEq)]
pub struct Variable {
    /// Name with its groups, as in `tire.front.stiffness`.
    pub name: String,
    /// What it is, in one sentence or two.
    pub description: Cow<'static, str>,
    /// Unit in the FMI spelling (`N.m`, `m/s2`), `1` if it has none.
    pub unit: &'static str,
    /// What its value may be.
    pub kind: Kind,
    /// Start value, also the default of a parameter.
    pub start: f64,
    /// Smallest and largest allowed value.
    pub range: (f64, f64),
    /// A parameter that may change while the estimator runs.
    pub tunable: bool,
    /// A measured input, for which NaN says "no sample at this instant".
    pub measured: bool,
    /// An input whose last valid value holds while it has none: a command, or what changes slowly.
    pub held: bool,
    /// A held input that the machine can do without: before its first valid value it is missing, not 0.
    pub optional: bool,
    /// A parameter that says how much the process noise drives a state.
    pub process_noise: bool,
    /// A parameter that says how noisy a sensor is.
    pub measurement_noise: bool,
    /// A parameter to set before all others: with another machine's value the estimates are wrong.
    pub essential: bool,
}

/// A parameter that was refused, with the reason.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{name} = {value}{unit} {reason}", unit = spaced(.unit))]
pub struct ParameterError {
    /// Name of the parameter.
    pub name: String,
    /// The value that was refused.
    pub value: f64,
    /// Unit of the value.
    pub unit: &'static str,
    /// What is wrong with it and what would be allowed.
    pub reason: String,
}

fn spaced(unit: &str) -> String {
    if unit == "1" { String::new() } else { format!(" {unit}") }
}

impl Variable {
    /// A variable without flags that starts at 0. The description of a [`Kind::Code`] lists its codes.
    pub fn new(
        name: String,
        description: impl Into<Cow<'static, str>>,
        unit: &'static str,
        kind: Kind,
        range: (f64, f64),
    ) -> Self {
        let mut description = description.into();
        if let Kind::Code(codes) = kind {
            for (number, word, meaning) in codes {
                description.to_mut().push_str(&format!(" {number} = {word}: {}", meaning.trim()));
            }
        }
        Self {
            name,
            description,
            unit,
            kind,
            start: 0.0,
            range,
            tunable: false,
            measured: false,
            held: false,
            optional: false,
            process_noise: false,
            measurement_noise: false,
            essential: false,
        }
    }

    /// Whether `value` is finite, of this kind and in range.
    pub fn check(&self, value: f64) -> Result<(), ParameterError> {
        let (low, high) = self.range;
        let whole = self.kind == Kind::Real || value.fract() == 0.0;
        if value >= low && value <= high && value.is_finite() && whole {
            return Ok(());
        }
        let reason = if value.is_nan() {
            "is not a number".to_owned()
        } else if !whole {
            "is not a whole number".to_owned()
        } else {
            format!("is outside the allowed range {low}..={high}{}", spaced(self.unit))
        };
        Err(self.refuse(value, reason))
    }

    /// An input that need not have a value at every instant: NaN says so.
    pub fn may_be_missing(&self) -> bool {
        self.measured || self.held
    }

    /// An error about this variable.
    pub fn refuse(&self, value: f64, reason: impl Into<String>) -> ParameterError {
        ParameterError { name: self.name.clone(), value, unit: self.unit, reason: reason.into() }
    }
}

/// The name of a field within its groups, without the mark of a raw identifier. A machine has more than a hundred and each
/// instance of its FMU makes them anew.
#[doc(hidden)]
pub fn joined(prefix: &str, field: &str) -> String {
    let field = field.strip_prefix("r#").unwrap_or(field);
    [prefix, field].concat()
}

/// A value or a group of values with a declaration, exchanged as a flat slice of `f64`.
///
/// Written by [`variables!`](crate::variables) and [`choice!`](crate::choice).
pub trait Variables: Clone + Send + Sync {
    /// Number of variables.
    const COUNT: usize;
    /// Appends the declarations, `prefix` being the groups around them (`"tire.front."` or empty).
    fn declare_into(prefix: &str, list: &mut Vec<Variable>);
    /// Writes the values in the order of the declarations; `flat` has [`COUNT`](Self::COUNT) slots.
    fn write(&self, flat: &mut [f64]);
    /// Takes the values in the order of the declarations.
    fn read(&mut self, flat: &[f64]);
    /// Replaces every value by what `f` makes of it, in the order of the declarations.
    fn map(&mut self, f: &mut impl FnMut(f64) -> f64);
    /// Whether every value has the same bits; NaN is the same as NaN.
    fn same(&self, other: &Self) -> bool;

    /// The declarations.
    fn declare() -> Vec<Variable> {
        let mut list = Vec::with_capacity(Self::COUNT);
        Self::declare_into("", &mut list);
        list
    }

    /// The values as a vector.
    fn to_vec(&self) -> Vec<f64> {
        let mut flat = vec![0.0; Self::COUNT];
        self.write(&mut flat);
        flat
    }

    /// Checks every value against its declaration.
    fn validate(&self) -> Result<(), ParameterError> {
        Self::declare().iter().zip(self.to_vec()).try_for_each(|(variable, value)| variable.check(value))
    }

    /// Sets one variable by its name; an unknown name gives an error that lists the nearest ones.
    fn set(&mut self, name: &str, value: f64) -> Result<(), ParameterError> {
        let index = find(&Self::declare(), name, value)?;
        let mut flat = self.to_vec();
        flat[index] = value;
        self.read(&flat);
        Ok(())
    }
}

/// The index of the variable `name` in the declarations, after its value (in its declared unit) has been checked. An
/// unknown name gives an error that lists the nearest ones, a value that is not allowed one with the allowed range.
pub fn find(declared: &[Variable], name: &str, value: f64) -> Result<usize, ParameterError> {
    let Some(index) = declared.iter().position(|variable| variable.name == name) else {
        let group = name.split('.').next().unwrap_or(name);
        let near: Vec<_> = declared.iter().map(|v| v.name.as_str()).filter(|n| n.starts_with(group)).collect();
        let hint = if near.is_empty() { String::new() } else { format!("; there are {}", near.join(", ")) };
        let reason = format!("is not a variable of this machine{hint}");
        return Err(ParameterError { name: name.to_owned(), value, unit: "1", reason });
    };
    declared[index].check(value)?;
    Ok(index)
}

/// What can stand in a declaration with a start value: one number, or an [`Estimate`] of two.
pub trait Field: Copy {
    /// Number of variables.
    const COUNT: usize;
    /// Appends the declarations; `variable` has name, description, unit, range and flags already.
    fn declare_into(self, variable: Variable, list: &mut Vec<Variable>);
    /// What the value may be.
    const KIND: Kind;
    /// Range of the type itself.
    const RANGE: (f64, f64);
    /// Writes the numbers.
    fn write(self, flat: &mut [f64]);
    /// From the numbers.
    fn read(flat: &[f64]) -> Self;
    /// Replaces every number by what `f` makes of it.
    fn map(self, f: &mut impl FnMut(f64) -> f64) -> Self;
    /// Whether every number has the same bits.
    fn same(self, other: Self) -> bool;
}

/// A single value that can stand in a declaration.
pub trait Value: Copy {
    /// What the value may be.
    const KIND: Kind;
    /// Range of the type itself.
    const RANGE: (f64, f64);
    /// As a number.
    fn to_number(self) -> f64;
    /// From a number, rounded into the type.
    fn from_number(number: f64) -> Self;
}

impl<V: Value> Field for V {
    const COUNT: usize = 1;
    const KIND: Kind = <V as Value>::KIND;
    const RANGE: (f64, f64) = <V as Value>::RANGE;
    fn declare_into(self, variable: Variable, list: &mut Vec<Variable>) {
        list.push(Variable { start: self.to_number(), ..variable });
    }
    fn write(self, flat: &mut [f64]) {
        flat[0] = self.to_number();
    }
    fn read(flat: &[f64]) -> Self {
        Self::from_number(flat[0])
    }
    fn map(self, f: &mut impl FnMut(f64) -> f64) -> Self {
        Self::from_number(f(self.to_number()))
    }
    fn same(self, other: Self) -> bool {
        self.to_number().to_bits() == other.to_number().to_bits()
    }
}

/// An estimated quantity with its standard deviation: `speed: Estimate = Estimate::NONE, "m/s"` declares the
/// variables `speed` and `speed_std`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The estimate, in the declared unit.
    pub value: f64,
    /// Its standard deviation, in the same unit.
    pub std: f64,
}

impl Estimate {
    /// Nothing is estimated: 0 with standard deviation 0.
    pub const NONE: Self = Self { value: 0.0, std: 0.0 };

    /// A value with its standard deviation.
    pub const fn new(value: f64, std: f64) -> Self {
        Self { value, std }
    }

    /// Counts an independent error with this standard deviation.
    #[inline]
    pub fn widen(&mut self, std: f64) {
        self.std = root_sum_square([self.std, std]);
    }
}

/// Standard deviation of the sum of independent errors with these standard deviations, at most the largest number. (`hypot`, which
/// is exact for the largest and the smallest numbers too, is a call of some forty instructions.)
#[inline]
pub fn root_sum_square<const N: usize>(stds: [f64; N]) -> f64 {
    stds.iter().map(|std| std * std).sum::<f64>().sqrt().min(f64::MAX)
}

impl Field for Estimate {
    const COUNT: usize = 2;
    const KIND: Kind = Kind::Real;
    const RANGE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
    fn declare_into(self, variable: Variable, list: &mut Vec<Variable>) {
        let std = Variable {
            name: format!("{}_std", variable.name),
            description: format!("Standard deviation of {}.", variable.name).into(),
            start: self.std,
            range: (0.0, f64::INFINITY),
            ..variable.clone()
        };
        list.extend([Variable { start: self.value, ..variable }, std]);
    }
    fn write(self, flat: &mut [f64]) {
        flat.copy_from_slice(&[self.value, self.std]);
    }
    fn read(flat: &[f64]) -> Self {
        Self { value: flat[0], std: flat[1] }
    }
    fn map(self, f: &mut impl FnMut(f64) -> f64) -> Self {
        Self { value: f(self.value), std: f(self.std) }
    }
    fn same(self, other: Self) -> bool {
        Field::same(self.value, other.value) && Field::same(self.std, other.std)
    }
}

impl Value for f64 {
    const KIND: Kind = Kind::Real;
    const RANGE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
    fn to_number(self) -> f64 {
        self
    }
    fn from_number(number: f64) -> Self {
        number
    }
}

impl Value for i32 {
    const KIND: Kind = Kind::Integer;
    const RANGE: (f64, f64) = (i32::MIN as f64, i32::MAX as f64);
    fn to_number(self) -> f64 {
        f64::from(self)
    }
    fn from_number(number: f64) -> Self {
        number.round() as i32
    }
}

impl Value for bool {
    const KIND: Kind = Kind::Boolean;
    const RANGE: (f64, f64) = (0.0, 1.0);
    fn to_number(self) -> f64 {
        f64::from(u8::from(self))
    }
    fn from_number(number: f64) -> Self {
        number >= 0.5
    }
}

/// Declares an enumeration whose values have names outside: `pub enum Law { Fixed = "fixed" }`.
/// The first one is the default.
#[macro_export]
macro_rules! choice {
    ($(#[$meta:meta])* $vis:vis enum $name:ident { $($(#[$inner:meta])* $item:ident = $text:literal),+ $(,)? }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        $vis enum $name { $($(#[$inner])* #[doc = concat!("`", $text, "`")] $item),+ }

        impl $name {
            const ALL: &'static [Self] = &[$(Self::$item),+];
        }

        impl $crate::variable::Value for $name {
            const KIND: $crate::variable::Kind = $crate::variable::Kind::Choice(&[$($text),+]);
            const RANGE: (f64, f64) = (0.0, (Self::ALL.len() - 1) as f64);
            fn to_number(self) -> f64 {
                self as usize as f64
            }
            fn from_number(number: f64) -> Self {
                Self::ALL[(number.max(0.0) as usize).min(Self::ALL.len() - 1)]
            }
        }
    };
}

/// Declares a condition as a number with a word and a meaning: `pub enum Mode { /// Meaning. Idle = 0, "idle" }`.
/// Outside it is a whole number, since some hosts know no enumerations; the description lists the codes.
/// The first one is the default.
#[macro_export]
macro_rules! code {
    ($(#[$meta:meta])* $vis:vis enum $name:ident {
        $($(#[doc = $doc:literal])+ $item:ident = $number:literal, $word:literal;)+
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, ::serde::Serialize, ::serde::Deserialize)]
        $vis enum $name { $($(#[doc = $doc])+ $item = $number),+ }

        impl $name {
            const ALL: &'static [Self] = &[$(Self::$item),+];
        }

        impl Default for $name {
            fn default() -> Self {
                Self::ALL[0]
            }
        }

        impl $crate::variable::Value for $name {
            const KIND: $crate::variable::Kind =
                $crate::variable::Kind::Code(&[$(($number, $word, concat!($($doc),+))),+]);
            const RANGE: (f64, f64) = {
                let (mut low, mut high) = (i32::MAX, i32::MIN);
                $(if $number < low { low = $number; })+
                $(if $number > high { high = $number; })+
                (low as f64, high as f64)
            };
            fn to_number(self) -> f64 {
                f64::from(self as i32)
            }
            fn from_number(number: f64) -> Self {
                Self::ALL.iter().copied().find(|item| f64::from(*item as i32) == number).unwrap_or_default()
            }
        }
    };
}

/// Declares a struct of variables and groups; the module's page has an example.
///
/// A variable is `name: type = start, "unit", [low, high], flags;` below its description, in which
/// the range may be left out and the flags are those of [`Variable`]: `tunable`, `measured`, `held`,
/// `optional`, `process_noise`, `measurement_noise`, `essential`. A group is `name: Type;`, and `@flat name: Type;` if
/// its variables keep their names outside.
#[macro_export]
macro_rules! variables {
    ($(#[$meta:meta])* $vis:vis struct $name:ident {
        $($(#[doc = $doc:literal])+ $(@ $flat:ident)? $field:ident : $type:ty
            $(= $start:expr, $unit:literal $(, [$low:expr, $high:expr])? $(, $flag:ident)*)? ;)+
    }) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        $vis struct $name { $($(#[doc = $doc])+ pub $field: $type),+ }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $crate::variables!(@default $type $(, $start)?)),+ }
            }
        }

        impl $crate::variable::Variables for $name {
            const COUNT: usize = 0 $(+ $crate::variables!(@count $type $(, $unit)?))+;

            fn declare_into(prefix: &str, list: &mut Vec<$crate::variable::Variable>) {
                $($crate::variables!(@declare prefix, list, [$($flat)?] $field, $type, concat!($($doc),+)
                    $(, $start, $unit, [$($low, $high)?], [$($flag)*])?);)+
            }

            fn write(&self, flat: &mut [f64]) {
                let mut rest = flat;
                $($crate::variables!(@write rest, self.$field, $type $(, $unit)?);)+
                debug_assert!(rest.is_empty());
            }

            fn read(&mut self, flat: &[f64]) {
                let mut rest = flat;
                $($crate::variables!(@read rest, self.$field, $type $(, $unit)?);)+
                debug_assert!(rest.is_empty());
            }

            fn map(&mut self, f: &mut impl FnMut(f64) -> f64) {
                $($crate::variables!(@map f, self.$field, $type $(, $unit)?);)+
            }

            fn same(&self, other: &Self) -> bool {
                true $(&& $crate::variables!(@same self.$field, other.$field, $type $(, $unit)?))+
            }
        }
    };

    // The rest distinguishes a group (no start value) from a variable.
    (@default $type:ty) => { <$type>::default() };
    (@default $type:ty, $start:expr) => { $start };
    (@count $type:ty) => { <$type as $crate::variable::Variables>::COUNT };
    (@count $type:ty, $unit:literal) => { <$type as $crate::variable::Field>::COUNT };

    (@declare $prefix:ident, $list:ident, [flat] $field:ident, $type:ty, $doc:expr) => {
        <$type as $crate::variable::Variables>::declare_into($prefix, $list);
    };
    (@declare $prefix:ident, $list:ident, [] $field:ident, $type:ty, $doc:expr) => {
        let prefix = $crate::variable::joined($prefix, concat!(stringify!($field), "."));
        <$type as $crate::variable::Variables>::declare_into(&prefix, $list);
    };
    (@declare $prefix:ident, $list:ident, [] $field:ident, $type:ty, $doc:expr,
        $start:expr, $unit:literal, [$($low:expr, $high:expr)?], [$($flag:ident)*]) => {
        #[allow(unused_mut)]
        let mut variable = $crate::variable::Variable::new(
            $crate::variable::joined($prefix, stringify!($field)),
            $doc.trim(),
            $unit,
            <$type as $crate::variable::Field>::KIND,
            <$type as $crate::variable::Field>::RANGE,
        );
        $(variable.range = ($low as f64, $high as f64);)?
        $(variable.$flag = true;)*
        let start: $type = $start;
        $crate::variable::Field::declare_into(start, variable, $list);
    };

    (@write $rest:ident, $value:expr, $type:ty) => {
        let (head, tail) = $rest.split_at_mut(<$type as $crate::variable::Variables>::COUNT);
        <$type as $crate::variable::Variables>::write(&$value, head);
        $rest = tail;
    };
    (@write $rest:ident, $value:expr, $type:ty, $unit:literal) => {
        let (head, tail) = $rest.split_at_mut(<$type as $crate::variable::Field>::COUNT);
        $crate::variable::Field::write($value, head);
        $rest = tail;
    };
    (@read $rest:ident, $value:expr, $type:ty) => {
        let (head, tail) = $rest.split_at(<$type as $crate::variable::Variables>::COUNT);
        <$type as $crate::variable::Variables>::read(&mut $value, head);
        $rest = tail;
    };
    (@read $rest:ident, $value:expr, $type:ty, $unit:literal) => {
        let (head, tail) = $rest.split_at(<$type as $crate::variable::Field>::COUNT);
        $value = <$type as $crate::variable::Field>::read(head);
        $rest = tail;
    };
    (@map $f:ident, $value:expr, $type:ty) => {
        <$type as $crate::variable::Variables>::map(&mut $value, $f);
    };
    (@map $f:ident, $value:expr, $type:ty, $unit:literal) => {
        $value = $crate::variable::Field::map($value, $f);
    };
    (@same $value:expr, $other:expr, $type:ty) => {
        <$type as $crate::variable::Variables>::same(&$value, &$other)
    };
    (@same $value:expr, $other:expr, $type:ty, $unit:literal) => {
        $crate::variable::Field::same($value, $other)
    };
}
