//! Spatial algebra: motions, wrenches, frames and inertias as 6-vectors and 6 x 6 matrices.
//!
//! The linear part comes first, the angular part last: a motion is `[v; w]`, a wrench `[f; m]`.
//! Featherstone, *Rigid Body Dynamics Algorithms* (2008), ch. 2, prints the angular part first; the
//! two differ by this permutation only. A motion and a wrench are taken at a frame's origin and in
//! its axes.

use nalgebra::{Matrix3, Matrix6, Rotation3, Unit, Vector3, Vector6};

/// The linear part of a motion or wrench.
pub fn linear(v: &Vector6<f64>) -> Vector3<f64> {
    Vector3::new(v[0], v[1], v[2])
}

/// The angular part of a motion, the moment of a wrench.
pub fn angular(v: &Vector6<f64>) -> Vector3<f64> {
    Vector3::new(v[3], v[4], v[5])
}

/// A motion or wrench from its two parts.
pub fn join(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(linear.x, linear.y, linear.z, angular.x, angular.y, angular.z)
}

/// Rotation about a unit axis by an angle in rad.
pub fn axis_rotation(axis: &Vector3<f64>, angle: f64) -> Matrix3<f64> {
    Rotation3::from_axis_angle(&Unit::new_unchecked(*axis), angle).into_inner()
}

/// Roll, pitch and yaw as URDF means them: `Rz(yaw) Ry(pitch) Rx(roll)`.
pub fn rpy_rotation([roll, pitch, yaw]: &[f64; 3]) -> Matrix3<f64> {
    Rotation3::from_euler_angles(*roll, *pitch, *yaw).into_inner()
}

/// The pose of a frame B in a frame A: `x_A = rotation x_B + origin`. By hand, since nalgebra's `Isometry3` rotates by
/// quaternion, which costs more where every pose meets many vectors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Axes of B in A.
    pub rotation: Matrix3<f64>,
    /// Origin of B in A, m.
    pub origin: Vector3<f64>,
}

impl Pose {
    /// B is A.
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), origin: Vector3::zeros() }
    }

    /// From an origin and roll, pitch, yaw as in URDF.
    pub fn from_xyz_rpy(xyz: &[f64; 3], rpy: &[f64; 3]) -> Self {
        Self { rotation: rpy_rotation(rpy), origin: Vector3::from(*xyz) }
    }

    /// The pose of A in B.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, origin: -(rotation * self.origin) }
    }

    /// `A_H_B * B_H_C = A_H_C`.
    pub fn compose(&self, inner: &Self) -> Self {
        Self { rotation: self.rotation * inner.rotation, origin: self.rotation * inner.origin + self.origin }
    }

    /// `[[R, p x R], [0, R]]`: takes motions from B to A.
    pub fn motion_matrix(&self) -> Matrix6<f64> {
        let mut x = Matrix6::zeros();
        x.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.rotation);
        x.fixed_view_mut::<3, 3>(0, 3).copy_from(&(self.origin.cross_matrix() * self.rotation));
        x.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.rotation);
        x
    }

    /// `[[R, 0], [p x R, R]]`: takes wrenches from B to A.
    pub fn wrench_matrix(&self) -> Matrix6<f64> {
        let mut x = Matrix6::zeros();
        x.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.rotation);
        x.fixed_view_mut::<3, 3>(3, 0).copy_from(&(self.origin.cross_matrix() * self.rotation));
        x.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.rotation);
        x
    }

    /// A motion given in B, in A.
    pub fn motion(&self, v: &Vector6<f64>) -> Vector6<f64> {
        let w = self.rotation * angular(v);
        join(&(self.rotation * linear(v) + self.origin.cross(&w)), &w)
    }

    /// A motion given in A, in B.
    pub fn motion_back(&self, v: &Vector6<f64>) -> Vector6<f64> {
        let w = angular(v);
        join(&self.rotation.tr_mul(&(linear(v) - self.origin.cross(&w))), &self.rotation.tr_mul(&w))
    }

    /// A wrench given in B, in A.
    pub fn wrench(&self, f: &Vector6<f64>) -> Vector6<f64> {
        let force = self.rotation * linear(f);
        join(&force, &(self.rotation * angular(f) + self.origin.cross(&force)))
    }
}

/// `v x u`: the rate of a motion `u` that is carried along by the motion `v`.
pub fn cross_motion(v: &Vector6<f64>, u: &Vector6<f64>) -> Vector6<f64> {
    let w = angular(v);
    join(&(w.cross(&linear(u)) + linear(v).cross(&angular(u))), &w.cross(&angular(u)))
}

/// `v x* f`: the rate of a wrench `f` (or momentum) that is carried along by the motion `v`.
pub fn cross_wrench(v: &Vector6<f64>, f: &Vector6<f64>) -> Vector6<f64> {
    let w = angular(v);
    let force = linear(f);
    join(&w.cross(&force), &(w.cross(&angular(f)) + linear(v).cross(&force)))
}

/// Mass, first moment and second moment of a body, at the origin and in the axes of its frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// Mass, kg.
    pub mass: f64,
    /// Mass times centre of mass, kg m.
    pub moment: Vector3<f64>,
    /// Rotational inertia about the frame's origin, kg m2.
    pub rotational: Matrix3<f64>,
}

impl Inertia {
    /// No mass.
    pub fn zero() -> Self {
        Self { mass: 0.0, moment: Vector3::zeros(), rotational: Matrix3::zeros() }
    }

    /// From the mass, the centre of mass and the rotational inertia about the centre of mass.
    pub fn from_centre(mass: f64, com: &Vector3<f64>, about_com: &Matrix3<f64>) -> Self {
        let c = com.cross_matrix();
        Self { mass, moment: com * mass, rotational: about_com - c * c * mass }
    }

    /// The same body seen from the frame A in which this inertia's frame has the pose `a_h_b`.
    pub fn seen_from(&self, a_h_b: &Pose) -> Self {
        let (r, p) = (&a_h_b.rotation, &a_h_b.origin);
        let moment = r * self.moment;
        let (c, s) = (moment.cross_matrix(), p.cross_matrix());
        // parallel axes with the first moment: I_A = R I R' - (p~ c~ + c~ p~) - m p~ p~
        let rotational = r * self.rotational * r.transpose() - s * c - c * s - s * s * self.mass;
        Self { mass: self.mass, moment: moment + p * self.mass, rotational }
    }

    /// Both bodies as one.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            mass: self.mass + other.mass,
            moment: self.moment + other.moment,
            rotational: self.rotational + other.rotational,
        }
    }

    /// `[[m 1, -c~], [c~, I_o]]` with the first moment c: motion to momentum.
    pub fn matrix(&self) -> Matrix6<f64> {
        let c = self.moment.cross_matrix();
        let mut i = Matrix6::zeros();
        i.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * self.mass));
        i.fixed_view_mut::<3, 3>(0, 3).copy_from(&-c);
        i.fixed_view_mut::<3, 3>(3, 0).copy_from(&c);
        i.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.rotational);
        i
    }

    /// The momentum of a motion, or the inertial wrench of an acceleration.
    pub fn times(&self, v: &Vector6<f64>) -> Vector6<f64> {
        let (l, w) = (linear(v), angular(v));
        join(&(l * self.mass - self.moment.cross(&w)), &(self.moment.cross(&l) + self.rotational * w))
    }
}
