//! Expressions over the columns of a log: arithmetic, comparisons, conditions.
//!
//! Truth is 1 and falsehood 0. A comparison with a missing sample is unknown (NaN), and an unknown
//! spreads, except where the other side decides: `true || unknown` is true and `false && unknown` is
//! false.

use exmex::{BinOp, Express, FlatEx, MakeOperators, NumberMatcher, Operator};

/// A parsed expression.
#[derive(Clone, Debug)]
pub struct Expression {
    /// Boxed because the library keeps small expressions in place, in about 20 kB.
    tree: Box<FlatEx<f64, Operators, NumberMatcher>>,
    /// The columns it reads, in the order of the tree's arguments.
    names: Vec<String>,
}

#[derive(Clone, Debug)]
struct Operators;

fn truth(is: bool) -> f64 {
    f64::from(u8::from(is))
}

fn compare(a: f64, b: f64, is: bool) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { truth(is) }
}

fn either(a: f64, b: f64) -> f64 {
    let is = |x: f64| !x.is_nan() && x != 0.0;
    if is(a) || is(b) { 1.0 } else { compare(a, b, false) }
}

fn both(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 { 0.0 } else { compare(a, b, true) }
}

impl MakeOperators<f64> for Operators {
    fn make<'a>() -> Vec<Operator<'a, f64>> {
        let binary = |name, prio, apply| Operator::make_bin(name, BinOp { apply, prio, is_commutative: false });
        vec![
            binary("||", 0, either),
            binary("&&", 1, both),
            binary("==", 2, |a, b| compare(a, b, a == b)),
            binary("!=", 2, |a, b| compare(a, b, a != b)),
            binary("<=", 2, |a, b| compare(a, b, a <= b)),
            binary(">=", 2, |a, b| compare(a, b, a >= b)),
            binary("<", 2, |a, b| compare(a, b, a < b)),
            binary(">", 2, |a, b| compare(a, b, a > b)),
            Operator::make_bin_unary("+", BinOp { apply: |a, b| a + b, prio: 3, is_commutative: true }, |a| a),
            Operator::make_bin_unary("-", BinOp { apply: |a, b| a - b, prio: 3, is_commutative: false }, |a| -a),
            binary("*", 4, |a, b| a * b),
            binary("/", 4, |a, b| a / b),
            binary("^", 5, f64::powf),
            Operator::make_unary("!", |a| if a.is_nan() { a } else { truth(a == 0.0) }),
            Operator::make_unary("abs", f64::abs),
            Operator::make_unary("sqrt", f64::sqrt),
            Operator::make_unary("sin", f64::sin),
            Operator::make_unary("cos", f64::cos),
            Operator::make_unary("missing", |a| truth(a.is_nan())),
        ]
    }
}

impl Expression {
    /// Parses an expression; the error shows it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let fail = |why: &str| {
            let why = why.lines().collect::<Vec<_>>().join(" ");
            format!("'{}' is not a condition or formula over columns: {why}", text.escape_debug())
        };
        if text.trim().is_empty() {
            return Err(fail("it is empty"));
        }
        let tree = FlatEx::<f64, Operators, NumberMatcher>::parse(text).map_err(|e| fail(e.msg()))?;
        let names = tree.var_names().to_vec();
        if names.is_empty() {
            return Err(fail("it names no column"));
        }
        Ok(Self { tree: Box::new(tree), names })
    }

    /// The columns it reads.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Its value at every sample; NaN where it has none. `arguments` are the columns of
    /// [`names`](Self::names), in that order.
    pub fn evaluate(&self, arguments: &[&[f64]], samples: usize) -> Vec<f64> {
        let mut row = vec![f64::NAN; arguments.len()];
        let value = |sample: usize| {
            for (slot, values) in row.iter_mut().zip(arguments) {
                *slot = values.get(sample).copied().unwrap_or(f64::NAN);
            }
            self.tree.eval(&row).unwrap_or(f64::NAN)
        };
        (0..samples).map(value).collect()
    }

    /// Makes those values missing for which the condition holds or cannot be evaluated.
    pub fn blank(&self, arguments: &[&[f64]], values: &mut [f64]) {
        let holds = self.evaluate(arguments, values.len());
        for (value, held) in values.iter_mut().zip(holds) {
            if held != 0.0 {
                *value = f64::NAN;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(text: &str, values: &[(&str, f64)]) -> f64 {
        let expression = Expression::parse(text).unwrap_or_else(|e| panic!("{e}"));
        let find = |name: &String| &values.iter().find(|(other, _)| other == name).expect("a column").1;
        let arguments: Vec<_> = expression.names().iter().map(|name| std::slice::from_ref(find(name))).collect();
        expression.evaluate(&arguments, 1)[0]
    }

    #[test]
    fn precedence_is_that_of_c() {
        let v = [("a", 2.0), ("b", 3.0)];
        assert_eq!(at("a + b * 2 > 7 && b < a || a == 2", &v), 1.0);
        assert_eq!(at("a < 1 || b > 1 && a < 1", &v), 0.0);
        assert_eq!(at("!(a < 1) && -a < -1", &v), 1.0);
        assert_eq!(at("(b - a) / 0.5", &v), 2.0);
        assert_eq!(at("a != b && a <= 2 && b >= 3", &v), 1.0);
    }

    #[test]
    fn names_may_contain_operators_and_anything_in_braces() {
        let v = [("max_torque", 2.0), ("absolute", 3.0), ("v right [m/s]", 4.0), ("missing_count", 1.0)];
        assert_eq!(at("max_torque + absolute + {v right [m/s]} + missing_count", &v), 10.0);
    }

    #[test]
    fn what_is_unknown_stays_unknown_unless_the_other_side_decides() {
        let v = [("x", f64::NAN), ("one", 1.0)];
        assert!(at("x < 3", &v).is_nan() && at("!(x < 3)", &v).is_nan() && at("x < 3 || one < 0", &v).is_nan());
        assert_eq!(at("x < 3 || one > 0", &v), 1.0);
        assert_eq!(at("x < 3 && one < 0", &v), 0.0);
        assert_eq!(at("missing(x)", &v), 1.0);
        assert_eq!(at("missing(one)", &v), 0.0);
    }

    #[test]
    fn a_wrong_expression_is_shown() {
        for text in ["", "1 < 2", "a <", "a ? b", "(a < 2", "a b"] {
            let error = Expression::parse(text).map(|_| ()).expect_err(text);
            assert!(error.contains(&format!("'{text}'")) && !error.contains('\n'), "{error}");
        }
    }
}
