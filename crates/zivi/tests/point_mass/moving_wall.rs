//! A moving wall: its motion against differences, and the frame against the fixed one.

use std::convert::Infallible;

use zivi::{ConstantForce, Dependence, Force, HarmonicWall, LinearForce, OnMovingWall, WallMotion};

const TABLE: HarmonicWall = HarmonicWall { amplitude: 0.3, omega: 4.0, phase: 0.7, offset: 0.2 };

fn at<W: WallMotion<Infallible>>(wall: &mut W, t: f64) -> [f64; 3] {
    let Ok(motion) = wall.at(t);
    motion
}

fn force<F: Force<Infallible>>(it: &mut F, t: f64, x: f64, xdot: f64) -> f64 {
    let Ok(value) = it.at(t, x, xdot);
    value
}

#[test]
fn velocity_and_acceleration_are_those_of_the_position() {
    let h = 1e-4;
    for k in 0..50 {
        let t = 0.1 * f64::from(k) - 2.0;
        let [before, here, after] = [t - h, t, t + h].map(|t| at(&mut { TABLE }, t));
        let expected = TABLE.offset + TABLE.amplitude * (TABLE.omega * t + TABLE.phase).cos();
        assert!((here[0] - expected).abs() < 1e-15);
        assert!(((after[0] - before[0]) / (2.0 * h) - here[1]).abs() < 1e-7);
        assert!(((after[1] - before[1]) / (2.0 * h) - here[2]).abs() < 1e-6);
    }
}

/// `y'' = f(t, y + w, y' + w') - w''`.
#[test]
fn the_force_is_asked_in_the_fixed_frame() {
    let spring = LinearForce {
        stiffness: 2.0,
        damping: 0.5,
        gravity: 9.81,
        amplitude: 0.4,
        omega: 3.0,
        phase: 0.1,
    };
    let mut moving = OnMovingWall { force: spring, wall: TABLE };
    for (t, y, ydot) in [(0.0, 0.0, 0.0), (1.3, 0.4, -2.0), (-7.0, 2.0, 5.0)] {
        let [w, wdot, wddot] = at(&mut { TABLE }, t);
        let (x, xdot) = (y + w, ydot + wdot);
        let fixed = -2.0 * x - 0.5 * xdot - 9.81 + 0.4 * f64::cos(3.0 * t + 0.1);
        assert!((force(&mut moving, t, y, ydot) - (fixed - wddot)).abs() < 1e-14);
    }
}

/// A free mass is still in the fixed frame: in the wall's it moves like `-w`, which the force says.
#[test]
fn a_mass_under_no_force_is_only_shifted() {
    let mut moving = OnMovingWall { force: ConstantForce(0.0), wall: TABLE };
    let (h, t0) = (1e-3, 0.4);
    let y = |t: f64| 5.0 - at(&mut { TABLE }, t)[0];
    let second = (y(t0 + h) - 2.0 * y(t0) + y(t0 - h)) / (h * h);
    assert!((force(&mut moving, t0, y(t0), 0.0) - second).abs() < 1e-4);
}

#[test]
fn what_is_constant_depends_on_time_above_a_moving_wall() {
    fn of<F: Force<Infallible>>(it: &F) -> Dependence {
        it.dependence()
    }
    assert_eq!(of(&OnMovingWall { force: ConstantForce(1.0), wall: TABLE }), Dependence::Time);
    let spring = LinearForce {
        stiffness: 2.0,
        damping: 0.0,
        gravity: 0.0,
        amplitude: 0.0,
        omega: 0.0,
        phase: 0.0,
    };
    assert_eq!(of(&OnMovingWall { force: spring, wall: TABLE }), Dependence::State);
}

/// Errors of the force or the wall are passed on.
#[test]
fn errors_pass_through() {
    #[derive(Clone, Copy)]
    struct Broken;
    impl WallMotion<&'static str> for Broken {
        fn at(&mut self, _: f64) -> Result<[f64; 3], &'static str> {
            Err("the wall fell down")
        }
    }
    let mut moving = OnMovingWall { force: ConstantForce(1.0), wall: Broken };
    assert_eq!(moving.at(0.0, 0.0, 0.0), Err("the wall fell down"));
}
