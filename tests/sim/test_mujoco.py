"""The MuJoCo backend: its model, its conventions and its contacts."""

import mujoco
import numpy as np
import pytest

from surefoot.config import SimulationConfig
from surefoot.sim.mujoco import MujocoSimulator, from_mujoco, to_mujoco
from surefoot.sim.mujoco_model import build_model
from surefoot.testing.driving import record_ticks, stamping_torque
from surefoot.types import JOINTS, LEGS
from tests.fakes.robots import REST, ROBOT, STANDING, random_states, varied


def test_model_is_the_urdf():
    model = build_model(ROBOT)
    assert (model.nq, model.nv, model.nu) == (19, 18, 0)
    assert tuple(model.joint(index).name for index in range(1, model.njnt)) == JOINTS
    assert model.body_mass.sum() == pytest.approx(ROBOT.mass, abs=1e-12)
    assert ROBOT.mass == pytest.approx(2.5, abs=1e-5)
    assert not model.dof_damping.any()
    assert not model.dof_armature.any()
    assert not model.dof_frictionloss.any()
    assert not model.jnt_limited.any()
    assert model.opt.timestep == 1e-3


def test_conversion_round_trip():
    q, v = random_states(200)
    qpos, qvel = to_mujoco(q, v)
    np.testing.assert_allclose(
        np.linalg.norm(qvel[:, :3], axis=1), np.linalg.norm(v[:, :3], axis=1)
    )
    back_q, back_v = from_mujoco(qpos, qvel)
    np.testing.assert_array_equal(back_q, q)
    np.testing.assert_allclose(back_v, v, atol=1e-14)


def test_touch_is_the_sum_of_contact_normals():
    """After the forces have been computed, and for feet only: legs and base do not count."""
    simulator = MujocoSimulator(ROBOT, 1)
    q, _ = random_states(1, height=0.12, seed=3)
    q[0, 3:7] = STANDING[3:7]
    simulator.reset(q, REST)
    feet = [simulator.model.geom(f"{leg}_FOOT").id for leg in LEGS]
    data = mujoco.MjData(simulator.model)
    force = np.zeros(6)
    others = 0
    seen = 0
    for tick in range(600):
        before = simulator.data(0)
        torque = stamping_torque(ROBOT, simulator.state, tick)
        simulator.step(torque)
        mujoco.mj_copyData(data, simulator.model, before)
        data.qfrc_applied[6:] = torque[0]
        mujoco.mj_step2(simulator.model, data)
        expected = np.zeros(4)
        for index in range(data.ncon):
            mujoco.mj_contactForce(simulator.model, data, index, force)
            if data.contact[index].geom[1] in feet:
                expected[feet.index(data.contact[index].geom[1])] += force[0]
            else:
                others += 1
        np.testing.assert_allclose(simulator.contact_force[0], expected, rtol=1e-12, atol=1e-12)
        seen += int((expected > 0).sum())
    assert seen > 100
    assert others > 0


def test_robot_meets_the_floor_only():
    """A robot that lies in itself feels nothing in the air, and every link on the floor."""
    simulator = MujocoSimulator(ROBOT, 1)
    q = STANDING.copy()[None]
    q[0, 2] = 1.0
    q[0, 8::3] = 0.0
    q[0, 9::3] = 3.1
    simulator.reset(q, REST)
    assert simulator.data(0).ncon == 0
    # Legs stretched out flat, 10 mm above the ground.
    q[0, 2] = 0.01
    q[0, 8::3] = np.pi / 2
    q[0, 9::3] = 0.0
    simulator.reset(q, REST)
    pairs = simulator.data(0).contact.geom
    assert {simulator.model.geom(pair[0]).name for pair in pairs} == {"floor"}
    touching = {simulator.model.geom(pair[1]).name for pair in pairs}
    assert touching == {shape.link for shape in ROBOT.shapes}


def test_varied_models_are_compiled_ones():
    """Also in what MuJoCo derives from masses, which makes contacts as stiff as they should be."""
    mass = np.array([1.0, 1.5])
    friction = np.array([0.3, 0.8])
    simulator = varied(MujocoSimulator(ROBOT, 2), friction, mass)
    for row in range(2):
        expected = build_model(ROBOT, SimulationConfig(friction=friction[row]))
        base = expected.body("base_link").id
        expected.body_mass[base] *= mass[row]
        expected.body_inertia[base] *= mass[row]
        mujoco.mj_setConst(expected, mujoco.MjData(expected))
        model = simulator.simulations.get_model(row)
        for name in (
            "geom_friction",
            "body_mass",
            "body_inertia",
            "body_subtreemass",
            "body_invweight0",
            "dof_invweight0",
            "dof_M0",
        ):
            np.testing.assert_array_equal(getattr(model, name), getattr(expected, name), name)


def test_pictures_do_not_change_the_physics():
    plain = MujocoSimulator(ROBOT, 1)
    pretty = MujocoSimulator(ROBOT, 1, visual=True)
    assert plain.model.nmesh == 0
    assert pretty.model.nmesh > 0
    assert pretty.model.camera("track").id >= 0
    np.testing.assert_array_equal(record_ticks(plain, 300), record_ticks(pretty, 300))
