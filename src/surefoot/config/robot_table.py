"""The robots of the package, as data. `example-robot-data` has their descriptions.

Nominal angles are those of the descriptions' own standing postures, except for Solo12, which stands
as in its public MPC. Boxes follow the extents of the trunks with their hip motors. Read
`config.robots` for what each field means, and `robots.load` for the models made from them.
"""

from __future__ import annotations

from collections.abc import Mapping

from surefoot.config.robots import RobotConfig, RobotSpec, Tuning

SOLO12 = RobotSpec(
    name="solo12",
    urdf="solo_description/robots/solo12.urdf",
    legs=("FL", "FR", "HL", "HR"),
    joints=("{leg}_HAA", "{leg}_HFE", "{leg}_KFE"),
    foot="{leg}_FOOT",
    front=(0.0, 0.8, -1.6),
    hind=(0.0, -0.8, 1.6),
    foot_radius=0.018,
    # Extents of the meshes: base 448 x 219 x 53 mm, upper leg 37 to 44 mm thick, lower leg 27 mm.
    body_center=(0.0, 0.0, 0.0015),
    body_half_edges=(0.2241, 0.1095, 0.0265),
    leg_radii=(0.0185, 0.0135),
    torque_limit=(2.7, 2.7, 2.7),  # peak of its actuator module (Grimminger et al., 2020)
    # At 0.25 m, the foot spheres are 9 mm above the ground; robots stand with them on the ground.
    nominal_height=0.25,
    # Gains, heights, weight and footholds of BiConMP's trot, and this package's capture time.
    tuning=Tuning(
        kp=3.0,
        kd=0.05,
        policy_kp=2.0,
        policy_kd=0.1,
        com_height=0.20,
        step_height=0.075,
        base_height=0.25,
        momentum_weight=500.0,
        capture_time=0.15,
        hip_outward=0.04,
    ),
)

_UNITREE_LEGS = ("FL", "FR", "RL", "RR")
_UNITREE_JOINTS = ("{leg}_hip_joint", "{leg}_thigh_joint", "{leg}_calf_joint")

GO2 = RobotSpec(
    name="go2",
    urdf="go2_description/urdf/go2.urdf",
    legs=_UNITREE_LEGS,
    joints=_UNITREE_JOINTS,
    foot="{leg}_foot",
    front=(0.068, 0.785, -1.44),
    hind=(0.068, 0.785, -1.44),
    foot_radius=0.022,
    body_center=(0.045, 0.0, 0.0),
    body_half_edges=(0.287, 0.097, 0.065),
    leg_radii=(0.022, 0.014),
)

GO1 = RobotSpec(
    name="go1",
    urdf="go1_description/urdf/go1.urdf",
    legs=_UNITREE_LEGS,
    joints=_UNITREE_JOINTS,
    foot="{leg}_foot",
    front=(0.0, 0.8, -1.853),
    hind=(0.0, 0.8, -1.853),
    foot_radius=0.02,
    body_center=(0.032, 0.0, 0.005),
    body_half_edges=(0.268, 0.097, 0.065),
    leg_radii=(0.017, 0.012),
    tuning=Tuning(kp=40.0, kd=0.9),  # with less, one perturbed robot in thirty falls
)

A1 = RobotSpec(
    name="a1",
    urdf="a1_description/urdf/a1.urdf",
    legs=_UNITREE_LEGS,
    joints=_UNITREE_JOINTS,
    foot="{leg}_foot",
    front=(0.0, 0.8, -1.81),
    hind=(0.0, 0.8, -1.81),
    foot_radius=0.02,
    body_center=(0.027, 0.0, 0.0),
    body_half_edges=(0.254, 0.097, 0.058),
    leg_radii=(0.017, 0.012),
    tuning=Tuning(kp=40.0, kd=0.9),  # with less, one perturbed robot in forty falls
)

ANYMAL_C = RobotSpec(
    name="anymal_c",
    urdf="anymal_c_simple_description/urdf/anymal.urdf",
    legs=("LF", "RF", "LH", "RH"),
    joints=("{leg}_HAA", "{leg}_HFE", "{leg}_KFE"),
    foot="{leg}_FOOT",
    front=(-0.1, 0.7, -1.0),
    hind=(-0.1, -0.7, 1.0),
    foot_radius=0.0175,
    body_half_edges=(0.526, 0.188, 0.107),
    leg_radii=(0.05, 0.025),
    tuning=Tuning(step_height=0.09),  # higher steps need joint rates far beyond its limit
)

HYQ = RobotSpec(
    name="hyq",
    urdf="hyq_description/robots/hyq_no_sensors.urdf",
    legs=("lf", "rf", "lh", "rh"),
    joints=("{leg}_haa_joint", "{leg}_hfe_joint", "{leg}_kfe_joint"),
    foot="{leg}_foot",
    front=(-0.2, 0.75, -1.5),
    hind=(-0.2, -0.75, 1.5),
    foot_radius=0.022,
    body_half_edges=(0.645, 0.298, 0.104),
    leg_radii=(0.045, 0.025),
    tuning=Tuning(step_height=0.09),
)

ROBOTS: Mapping[str, RobotSpec] = {
    spec.name: spec for spec in (SOLO12, GO2, GO1, A1, ANYMAL_C, HYQ)
}
"""The robots of the package, by name."""


def tuning_of(robot: RobotConfig) -> Tuning:
    """The tuning of a configured robot, if its spec is known.

    Args:
        robot: The robot's configuration; if it names a file, the tuning is not known here.
    """
    spec = robot.spec or ROBOTS.get(robot.model)
    return Tuning() if spec is None else spec.tuning
