"""Names, units and defaults that users' scripts, logs and simulations depend on: they never change.

Written down here a second time on purpose: a name that is changed in its declaration fails here.
`{a,b}` stands for either.
"""

import re

import fmpy
import pytest
from conftest import FMUS

JOINTS = (
    "lumbar_x lumbar_y thorax_y thorax_z neck_x neck_y neck_z right_shoulder_x right_shoulder_y right_shoulder_z "
    "right_elbow_y left_shoulder_x left_shoulder_y left_shoulder_z left_elbow_y right_hip_y right_knee_y left_hip_y "
    "left_knee_y"
).split()
JOINT = "{" + ",".join(JOINTS) + "}"
WHEEL = "{fl,fr,rl,rr}"
LIMB = "{right_hand,left_hand,right_foot,left_foot}"

INPUTS = {
    "NursingRobot": {
        "torque_{left,right}": "N.m",
        "speed": "m/s",
        "{yaw_rate,tilt_rate,roll_rate}": "rad/s",
        "{tilt,roll}": "rad",
        "accel_x": "m/s2",
    },
    "WheeledRobot": {
        "steering_angle": "rad",
        "{drive,brake}_torque_" + WHEEL: "N.m",
        "wheel_speed_" + WHEEL: "rad/s",
        "accel_{x,y}": "m/s2",
        "gyro_z": "rad/s",
        "speed": "m/s",
    },
    "WheelLoader": {
        "{torque,brake}_{front,rear}": "N.m",
        "slope": "rad",
        "spading_force_{x,z}": "N",
        "speed": "m/s",
        "wheel_speed_{front,rear}": "rad/s",
    },
    "HumanDynamics": {
        "q_" + JOINT: "rad",
        "qd_" + JOINT: "rad/s",
        "qdd_" + JOINT: "rad/s2",
        "base_gyro_{x,y,z}": "rad/s",
        "base_accel_{x,y,z}": "m/s2",
        "base_angular_accel_{x,y,z}": "rad/s2",
        "seat_force_{x,y,z}": "N",
        "seat_moment_{x,y,z}": "N.m",
        "imu_{thorax,head,right_forearm,left_forearm}_accel_{x,y,z}": "m/s2",
        LIMB + "_force_{x,y,z}": "N",
        LIMB + "_moment_{x,y,z}": "N.m",
    },
    "Wheelchair": {
        "encoder_{left,right}": "rad",
        "gyro_pitch": "rad/s",
        "accel_{x,y,z}": "m/s2",
        "drive_force": "N",
        "drive_moment": "N.m",
    },
}

# every one of these has a standard deviation beside it
ESTIMATES = {
    "NursingRobot": {
        "load_mass": "kg",
        "body_pitch": "rad",
        "body_pitch_rate": "rad/s",
        "sway_force": "N",
        "hip_torque": "N.m",
        "{load_cog,cog}_{x,z}": "m",
        "speed_estimate": "m/s",
    },
    "WheeledRobot": {
        "speed_{x,y}": "m/s",
        "yaw_rate": "rad/s",
        "sideslip": "rad",
        "wheel_force_{x,y}_" + WHEEL: "N",
        "wheel_load_" + WHEEL: "N",
    },
    "WheelLoader": {
        "{cg_ratio,slip_stiffness,load_ratio}": None,
        "{cg_height,cg_to_rear_axle}": "m",
        "speed_estimate": "m/s",
    },
    "HumanDynamics": {
        "tau_" + JOINT: "N.m",
        "seat_wrench_force_{x,y,z}": "N",
        "seat_wrench_moment_{x,y,z}": "N.m",
    },
    "Wheelchair": {
        "distance": "m",
        "{heading,slope,pitch}": "rad",
        "speed": "m/s",
        "{yaw_rate,slope_rate}": "rad/s",
    },
}

OTHER_OUTPUTS = {
    "NursingRobot": "mass_valid mass_status sway_status forgetting_factor nis",
    "WheeledRobot": "nis",
    "WheelLoader": "hold cg_height_observable nis",
    "HumanDynamics": "com_{x,y,z} body_mass chi2_{joint_acceleration,base_acceleration,seat_wrench,imu,hand_wrench,foot_wrench}",
    "Wheelchair": "standstill nis",
}

PARAMETERS = {
    "NursingRobot": "robot.{mass,track,wheel_radius,wheel_inertia,rotating_mass,drive_efficiency,seat_height} "
    "rolling.{coefficient,smoothing_speed} aero.{drag_area,air_density} human.{nominal_mass,swaying_fraction,com_height,"
    "gyration_radius,stiffness_pitch,damping_pitch,rest_pitch,stiffness_roll,damping_roll,rest_roll} "
    "mass.{law,compensate_sway,use_accelerometer} sway.{model,adaptive,use_tilt,use_tilt_rate}",
    "WheeledRobot": "vehicle.{mass,yaw_inertia,cg_to_front,cg_to_rear,track_front,track_rear,cg_height} wheel.{radius,inertia} "
    "tire.{front,rear}.{stiffness,nominal_load,load_sensitivity,shape,friction,friction_slope,curvature} "
    "observer.{gain,amplitude,steepness,nominal_rate,feedforward,adaptive,force_limit} "
    "filter.{channels,gate,minimum_speed,integrator,substeps,use_speed} filter.process_psd.{speed_x,speed_y,yaw_rate} "
    "filter.measurement_std.{accel_x,accel_y,gyro_z,speed} initial.speed_x",
    "WheelLoader": "loader.{mass,wheelbase,wheel_radius_front,wheel_radius_rear,axle_inertia_front,axle_inertia_rear,"
    "bucket_reach,bucket_height} rolling.coefficient tire.friction initial.{slip_stiffness,cg_height,cg_ratio} "
    "initial.{slip_stiffness,cg_height,cg_ratio}_std filter.{kind,form,parameters,alpha,beta,kappa}",
    "HumanDynamics": "",
    "Wheelchair": "chair.{mass,yaw_inertia,com_ahead,drag,yaw_drag,yaw_friction,wheel_radius,reference_to_right,"
    "reference_to_left,wheel_inertia} rolling.coefficient imu.{x,y,z} initial.heading filter.{model,kind,detect_standstill}",
}

DEFAULTS = {
    "NursingRobot": {"limit.torque": 60, "limit.speed": 3, "limit.load_mass": 250, "limit.slip_residual": 250},
    "WheeledRobot": {"rolling.coefficient": 0},
    "WheelLoader": {},
    "HumanDynamics": {
        "body.height": 1.7,
        "body.mass": 65,
        "sample_period": 0.01,
        "differentiate": False,
        "differentiation.window": 25,
        "use.{joint_acceleration,base_acceleration}": True,
        "use.{seat_wrench,imu,hand_wrench,foot_wrench}": False,
        "variance.equation.{acceleration,net_wrench,wrench_balance,torque}": 1e-4,
        "variance.prior": 1e4,
        "variance.prior_seat": 1e6,
        "variance.prior_hand_force": 900,
        "variance.prior_hand_moment": 100,
        "variance.prior_foot_force": 6400,
        "variance.prior_foot_moment": 1600,
        "variance.no_contact": 1e-4,
        "variance.joint_acceleration": 0.25,
        "variance.base_acceleration": 0.0025,
        "variance.base_angular_acceleration": 0.09,
        "variance.imu_acceleration": 9e-4,
        "variance.{seat,foot}_force": 4,
        "variance.{seat,foot}_moment": 0.09,
        "variance.hand_force": 0.25,
        "variance.hand_moment": 0.0025,
        "mount.{seat,imu_thorax,imu_head,imu_right_forearm,imu_left_forearm,right_hand,left_hand,right_foot,left_foot}.{x,y}": 0,
        "mount.seat.z": -0.1,
        "mount.imu_{thorax,head,right_forearm,left_forearm}.z": 0.1,
        "mount.{right,left}_hand.z": -0.2,
        "mount.{right,left}_foot.z": -0.4,
    },
    "Wheelchair": {"encoder.counts_body_pitch": True, "filter.kind": 2},  # bias
}

CHOICES = {
    "NursingRobot": {
        "mass.law": {"threshold", "exponential", "fixed"},
        "sway.model": {"auto", "paper_raw", "paper", "sound", "sound_torque"},
    },
    "WheeledRobot": {"filter.channels": {"patent", "gyro", "wheel_speed"}, "filter.integrator": {"euler", "rk4"}},
    "WheelLoader": {
        "filter.kind": {"srukf", "ekf"},
        "filter.form": {"array", "andrews"},
        "filter.parameters": {"logit", "direct"},
    },
    "HumanDynamics": {},
    "Wheelchair": {
        "filter.model": {"paper", "full"},
        "filter.kind": {"basic", "bias", "acceleration_input", "gravity_vector"},
    },
}


def names(pattern):
    """All names that a pattern stands for."""
    match = re.search(r"\{([^{}]*)\}", pattern)
    if not match:
        return [pattern]
    ends = [pattern[: match.start()] + word + pattern[match.end() :] for word in match.group(1).split(",")]
    return [name for end in ends for name in names(end)]


@pytest.fixture(params=sorted(INPUTS))
def contract(request):
    description = fmpy.read_model_description(str(FMUS / f"{request.param}.fmu"))
    return request.param, {v.name: v for v in description.modelVariables}, description


def test_inputs_have_the_names_and_units_of_the_contract(contract):
    model, variables, _ = contract
    for pattern, unit in INPUTS[model].items():
        for name in names(pattern):
            assert (variables[name].causality, variables[name].unit) == ("input", unit), name


def test_estimates_have_standard_deviations(contract):
    model, variables, _ = contract
    for pattern, unit in ESTIMATES[model].items():
        for name in names(pattern):
            for variable in (variables[name], variables[name + "_std"]):
                assert variable.causality == "output" and variable.unit in (unit, unit or "1"), variable.name
    for pattern in (OTHER_OUTPUTS[model] + " status healthy").split():
        for name in names(pattern):
            assert variables[name].causality == "output", name


def test_parameters_have_the_defaults_of_the_contract(contract):
    model, variables, _ = contract
    for pattern in PARAMETERS[model].split():
        for name in names(pattern):
            assert variables[name].causality == "parameter", name
    for pattern, start in DEFAULTS[model].items():
        for name in names(pattern):
            variable = variables[name]
            given = variable.start == "true" if variable.type == "Boolean" else float(variable.start)
            assert variable.causality == "parameter" and given == start, name


def test_choices_are_those_of_the_contract(contract):
    model, variables, _ = contract
    for name, items in CHOICES[model].items():
        assert {item.name for item in variables[name].declaredType.items} == items, name
