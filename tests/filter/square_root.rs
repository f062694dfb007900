//! Square-root updates against reference vectors, against each other and where others fail.

use crate::support::{assert_close, vector_table};
use nalgebra::{Cholesky, SMatrix, SVector};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use wheelstate::filter::square_root::{FactorUpdate, absorb, absorb_diagonal, andrews, array, joseph, std_of, tria};

type M6 = SMatrix<f64, 6, 6>;

fn lower(row: &[f64]) -> M6 {
    let mut s = M6::zeros();
    let mut next = row.iter();
    for i in 0..6 {
        for j in 0..=i {
            s[(i, j)] = *next.next().unwrap();
        }
    }
    s
}

#[test]
fn updates_match_the_reference_vectors() {
    let table = vector_table("wheel_loader/sr_update.csv");
    assert_eq!(table.rows.len(), 60);
    for (k, row) in table.rows.iter().enumerate() {
        let z = SVector::<f64, 6>::from_row_slice(&row[0..6]);
        let s = lower(&row[6..27]);
        let nu = SVector::<f64, 3>::from_row_slice(&row[27..30]);
        let v = SMatrix::<f64, 3, 3>::from_diagonal(&SVector::from_row_slice(&row[30..33]));
        let hs: SMatrix<f64, 3, 6> = s.fixed_rows::<3>(0).into_owned();
        for (form, update) in [("array", array(&s, &hs, &v)), ("andrews", andrews(&s, &hs, &v))] {
            let z_post = z + update.step(&nu);
            let by_gain = z + update.gain() * nu;
            let s_post = lower(&row[39..60]);
            for i in 0..6 {
                assert_close(&format!("{form} row {k} z{i}"), z_post[i], row[33 + i], 0.0, 1e-10);
                assert_close(&format!("{form} row {k} z{i} by the gain"), by_gain[i], row[33 + i], 0.0, 1e-9);
                for j in 0..6 {
                    assert_close(&format!("{form} row {k} S{i}{j}"), update.factor[(i, j)], s_post[(i, j)], 0.0, 1e-10);
                }
            }
            let joseph = joseph(&s, &hs, &v, &update.gain());
            assert!((joseph * joseph.transpose() - s_post * s_post.transpose()).amax() < 1e-10);
        }
    }
}

/// Only the first three states are measured: what the update does to the other columns is nothing.
#[test]
fn the_leading_columns_are_enough() {
    let table = vector_table("wheel_loader/sr_update.csv");
    for row in &table.rows {
        let s = lower(&row[6..27]);
        let v = SMatrix::<f64, 3, 3>::from_diagonal(&SVector::from_row_slice(&row[30..33]));
        let (leading, hs) = (s.fixed_columns::<3>(0).into_owned(), s.fixed_view::<3, 3>(0, 0).into_owned());
        for update in [array(&leading, &hs, &v), andrews(&leading, &hs, &v)] {
            let mut factor = s;
            factor.fixed_columns_mut::<3>(0).copy_from(&update.factor);
            assert!((factor - lower(&row[39..60])).amax() < 1e-10);
        }
    }
}

/// The van der Merwe update: downdates the factor by the columns of `K U`.
fn downdate(s: &M6, update: &FactorUpdate<6, 3, 6>) -> Result<M6, usize> {
    let mut l = *s;
    for column in 0..3 {
        let mut x = update.whitened_gain.column(column).into_owned();
        for i in 0..6 {
            let square = l[(i, i)] * l[(i, i)] - x[i] * x[i];
            if square <= 0.0 || square.is_nan() {
                return Err(i);
            }
            let r = square.sqrt();
            let (c, t) = (r / l[(i, i)], x[i] / l[(i, i)]);
            l[(i, i)] = r;
            for k in i + 1..6 {
                l[(k, i)] = (l[(k, i)] - t * x[k]) / c;
                x[k] = c * x[k] - t * l[(k, i)];
            }
        }
    }
    Ok(l)
}

#[test]
fn downdating_fails_where_the_orthogonal_forms_do_not() {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let v = SMatrix::<f64, 3, 3>::identity() * 1e-9;
    let mut failed = 0;
    for _ in 0..500 {
        let mut s = M6::zeros();
        for i in 0..6 {
            let scale = 10f64.powf(-7.0 * i as f64 / 5.0);
            for j in 0..=i {
                s[(i, j)] = scale * (2.0 * random.random::<f64>() - 1.0);
            }
            s[(i, i)] = s[(i, i)].abs() + 0.01 * scale;
        }
        let hs: SMatrix<f64, 3, 6> = s.fixed_rows::<3>(0).into_owned();
        for update in [array(&s, &hs, &v), andrews(&s, &hs, &v)] {
            assert!((0..6).all(|i| update.factor[(i, i)] > 0.0 && std_of(&update.factor, i).is_finite()));
        }
        failed += usize::from(downdate(&s, &array(&s, &hs, &v)).is_err());
    }
    println!("downdate failed in {failed} of 500 updates, array and andrews in none");
    assert!(failed > 250, "the comparison no longer shows what it is for: {failed}");
}

#[test]
fn consider_update_protects_rows() {
    let mut s = M6::identity() * 0.3;
    for i in 3..6 {
        for j in 0..3 {
            s[(i, j)] = 0.05 * (i as f64 - j as f64);
        }
    }
    let hs: SMatrix<f64, 3, 6> = s.fixed_rows::<3>(0).into_owned();
    let v = SMatrix::<f64, 3, 3>::identity() * 0.1;
    let mut gain = array(&s, &hs, &v).gain();
    gain.fixed_rows_mut::<3>(3).fill(0.0);
    let after = joseph(&s, &hs, &v, &gain);
    for i in 3..6 {
        assert_close("protected std", std_of(&after, i), std_of(&s, i), 1e-13, 0.0);
    }
    assert!((0..3).all(|i| std_of(&after, i) < std_of(&s, i)));
}

#[test]
fn rank_deficient_blocks_give_zero_pivots_and_stay_finite() {
    let column = SMatrix::<f64, 3, 1>::new(1.0, -2.0, 0.5);
    let l = tria(column);
    assert!((l * l.transpose() - column * column.transpose()).amax() < 1e-15);
    assert!(l.iter().all(|x| x.is_finite()));
    assert_eq!(tria(SMatrix::<f64, 4, 2>::zeros()), SMatrix::<f64, 4, 4>::zeros());
}

/// Correlations that fade by the same factor at every step reach the smallest numbers there are.
#[test]
fn fading_correlations_underflow_without_harm() {
    let mut s = M6::identity() * 0.3;
    s[(3, 0)] = 0.1;
    s[(5, 2)] = -0.1;
    let v = SMatrix::<f64, 3, 3>::identity() * 0.05;
    for _ in 0..5000 {
        absorb_diagonal(&mut s, &SVector::<f64, 6>::from([0.05, 0.2, 0.2, 0.0, 0.0, 0.0]));
        let hs: SMatrix<f64, 3, 6> = s.fixed_rows::<3>(0).into_owned();
        let mut gain = array(&s, &hs, &v).gain();
        gain.fixed_rows_mut::<3>(3).fill(0.0);
        s = joseph(&s, &hs, &v, &gain);
        assert!(s.iter().all(|x| x.is_finite()));
    }
    assert_close("protected std", std_of(&s, 3), 0.1f64.hypot(0.3), 1e-10, 0.0);
    let tiny = SMatrix::<f64, 2, 3>::from_element(1e-200);
    assert!(tria(tiny).iter().all(|x| x.is_finite()));
}

proptest! {
    #[test]
    fn tria_is_the_cholesky_factor_of_the_product(elements in prop::collection::vec(-10.0..10.0f64, 4 * 9)) {
        let a = SMatrix::<f64, 4, 9>::from_row_slice(&elements);
        let product = a * a.transpose();
        let l = tria(a);
        let scale = product.amax();
        prop_assert!((l * l.transpose() - product).amax() <= 1e-13 * scale);
        for i in 0..4 {
            prop_assert!(l[(i, i)] >= 0.0);
            for j in i + 1..4 {
                prop_assert_eq!(l[(i, j)], 0.0);
            }
        }
        if let Some(reference) = Cholesky::new(product)
            && reference.l().diagonal().min() > 1e-3
        {
            prop_assert!((reference.l() - l).amax() <= 1e-8 * scale.sqrt());
        }
    }

    #[test]
    fn absorbing_in_pieces_is_absorbing_at_once(
        elements in prop::collection::vec(-3.0..3.0f64, 4 * 7), std in prop::collection::vec(0.0..2.0f64, 4)
    ) {
        let a = SMatrix::<f64, 4, 7>::from_row_slice(&elements);
        let std = SVector::<f64, 4>::from_row_slice(&std);
        let mut l = tria(a.fixed_columns::<3>(0).into_owned());
        absorb(&mut l, a.fixed_columns::<4>(3).into_owned());
        absorb_diagonal(&mut l, &std);
        let sum = a * a.transpose() + SMatrix::from_diagonal(&std.component_mul(&std));
        prop_assert!((l * l.transpose() - sum).amax() <= 1e-13 * sum.amax());
        prop_assert!((0..4).all(|i| l[(i, i)] >= 0.0));
    }
}
