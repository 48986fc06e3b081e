"""Exports everything from sensors to joint targets as one ONNX graph, for controllers of exploy.

Inputs and outputs have the names that RAI's exploy gives them, by which its controllers match them.
The graph computes the direction of gravity, and feet and center of mass by products of exponentials
(`deploy.kinematics`), in float64, and the network in float32. The history is an explicit input and
output: the samples of the last ticks, oldest first. It is all zeros where an episode begins; the
first sample then stands for all of them. Read `file` for the network alone.
"""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np

from surefoot.deploy.description import PolicyDescription
from surefoot.deploy.kinematics import LEG_JOINTS, KinematicTable
from surefoot.interop.onnx.builder import DOUBLE, INT32, INT64, SINGLE, GraphBuilder
from surefoot.interop.onnx.file import INPUT, OUTPUT, OnnxModel, network_model
from surefoot.learning.layouts import History
from surefoot.learning.onnx_graph import IR_VERSION, OPSET, ROWS
from surefoot.learning.policy import Policy
from surefoot.types import JOINTS, LEGS

BASE = "base"
"""The name of the root body, and of its IMU."""
MEMORY_IN = "memory.history.in"
MEMORY_OUT = "memory.history.out"
COMMAND = "cmd.se2_velocity.command"
STEP_COUNT = "ctx.step_count"
"""The gait clock: the number of ticks since the policy began to drive."""
GAIT = "cmd.float.gait"
"""Which of several gaits to walk, as an index into the gaits of the file."""
EXPLOY_VERSION = "0.1.0"
"""The version of exploy whose conventions the names follow."""

# Entry k of the rotation matrix, row by row, is that of the identity plus two signed products of
# components of the quaternion, here w, x, y, z; see `surefoot.rotations`.
_W, _X, _Y, _Z = range(4)
_A = (_Y, _X, _X, _X, _X, _Y, _X, _Y, _X)
_B = (_Y, _Y, _Z, _Y, _X, _Z, _Z, _Z, _X)
_C = (_Z, _Z, _Y, _Z, _Z, _X, _Y, _X, _Y)
_D = (_Z, _W, _W, _W, _Z, _W, _W, _W, _Y)
_FIRST = 2.0 * np.array([-1, 1, 1, 1, -1, 1, 1, 1, -1])
_SECOND = 2.0 * np.array([-1, -1, 1, 1, -1, -1, -1, 1, -1])


def pipeline_model(policy: Policy, description: PolicyDescription) -> OnnxModel:
    """The whole pipeline of a policy as an ONNX model, without metadata.

    Args:
        policy: The policy.
        description: Its description, for the geometry, the gains and the limits.

    Raises:
        ValueError: The policy sees its height above its feet, which no input of the graph has.
    """
    spec = policy.spec.observation
    if description.height == "above_feet" and "base_height" in spec.layout.parts:
        raise ValueError(
            "the policy sees the height above its loaded feet, as all do that were trained on a "
            "terrain, but the controllers that a pipeline is for give the height in the world: "
            "export the network alone, with --onnx and without --pipeline, and give it that "
            "height; or train with --config.policy.layout proprioceptive, which sees no height"
        )
    history = spec.layout.history
    graph = GraphBuilder()
    measured = _inputs(graph, description)
    parts = _parts(graph, measured, description.kinematics)
    observation = [graph.cast(parts[name], SINGLE) for name in spec.layout.parts]
    ring = ""
    if history is not None:
        ring = _begun(graph, parts, history)
        samples = graph.picked(ring, *range(0, history.reach, history.stride))
        observation.append(graph.shaped(samples, 1, history.size))
    inputs = graph.joined([*observation, *_goal(graph, policy, measured)])
    target = _network(graph, policy, inputs)
    _add_outputs(graph, description, inputs, target, spec.input_size)
    if history is not None:
        sample = [parts[name] for name in history.parts]
        if history.targets:
            sample.append(_applied(graph, graph.cast(target, DOUBLE), measured, description))
        newest = graph.shaped(graph.cast(graph.joined(sample), SINGLE), 1, 1, history.sample_size)
        later = graph.picked(ring, *range(1, history.reach))
        shape = (1, history.reach, history.sample_size)
        graph.output(MEMORY_OUT, shape, graph.joined([later, newest]))
    return graph.model("pipeline")


def network_part(content: bytes) -> bytes:
    """The network of a whole pipeline, as a model ``(n, inputs) -> (n, 12)`` by itself.

    Args:
        content: The pipeline, serialized.
    """
    from onnx import helper, load_from_string

    graph = load_from_string(content).graph
    nodes = [node for node in graph.node if node.op_type in ("Gemm", "Relu")]
    used = {name for node in nodes for name in node.input}
    tensors = [tensor for tensor in graph.initializer if tensor.name in used]
    sizes = {tensor.name: list(tensor.dims) for tensor in tensors}
    inputs = sizes[nodes[0].input[1]][0]
    ends = [
        helper.make_tensor_value_info(name, SINGLE, [ROWS, size])
        for name, size in ((nodes[0].input[0], inputs), (nodes[-1].output[0], len(JOINTS)))
    ]
    network = helper.make_graph(nodes, "network", ends[:1], ends[1:], tensors)
    opset = helper.make_opsetid("", OPSET)
    model = helper.make_model(network, opset_imports=[opset], ir_version=IR_VERSION)
    return model.SerializeToString()


def input_names(description: PolicyDescription) -> dict[str, str]:
    """The name of each input of the graph, by the quantity that it holds.

    A policy that sees height or linear velocity takes the state of the base; any other policy takes
    what the IMU measures.

    Args:
        description: The description of the policy.
    """
    robot = description.robot
    asked = {term.name for term in description.observation}
    needs_base = bool(asked & {"base_height", "linear_velocity"})
    source = f"obj.{robot}.{BASE}" if needs_base else f"sensor.imu.{BASE}"
    names = {
        "joint_position": f"obj.{robot}.joints.pos",
        "joint_velocity": f"obj.{robot}.joints.vel",
        "orientation": f"{source}.w_Q_b",
        "angular_velocity": f"{source}.ang_vel_b_rt_w_in_b",
    }
    if needs_base:
        names["base_position"] = f"{source}.pos_b_rt_w_in_w"
        names["linear_velocity"] = f"{source}.lin_vel_b_rt_w_in_b"
    names["command"] = COMMAND
    names["tick"] = STEP_COUNT
    if len(description.gaits) > 1:
        names["gait"] = GAIT
    if description.history is not None:
        names["history"] = MEMORY_IN
    return names


def output_name(description: PolicyDescription) -> str:
    """The name of the joint targets, to which `.pos`, `.vel` and `.effort` are appended."""
    return f"output.joint_targets.{description.robot}"


def exploy_keys(description: PolicyDescription) -> dict[str, str]:
    """The metadata that exploy's controllers read, as JSON texts.

    Args:
        description: The description of the policy.
    """
    low, high = description.command_range
    axes = ("lin_vel_x", "lin_vel_y", "ang_vel_z")
    joints = list(description.joints)
    values = {
        "exploy_version": EXPLOY_VERSION,
        "update_rate": float(description.rate_hz),
        "base_names": {description.robot: BASE},
        f"obj.{description.robot}.joints": {"joint_names": joints},
        output_name(description): {
            "names": joints,
            "stiffness": list(description.kp),
            "damping": list(description.kd),
        },
        COMMAND: {"ranges": {axis: [low[i], high[i]] for i, axis in enumerate(axes)}},
    }
    return {key: json.dumps(value) for key, value in values.items()}


def _inputs(graph: GraphBuilder, description: PolicyDescription) -> dict[str, str]:
    """Add the inputs: measurements and command as float64, tick and gait as int64, the history."""
    sizes = {"joint_position": len(JOINTS), "joint_velocity": len(JOINTS), "orientation": 4}
    measured = {}
    for part, name in input_names(description).items():
        if part == "history":
            history = description.spec.layout.history
            if history is not None:
                measured[part] = graph.input(name, (1, history.reach, history.sample_size))
        elif part == "tick":
            measured[part] = graph.cast(graph.input(name, (1, 1), INT32), INT64)
        elif part == "gait":
            measured[part] = graph.cast(graph.input(name, (1, 1)), INT64)
        else:
            measured[part] = graph.cast(graph.input(name, (1, sizes.get(part, 3))), DOUBLE)
    return measured


def _parts(
    graph: GraphBuilder, measured: Mapping[str, str], table: KinematicTable
) -> dict[str, str]:
    """All parts of an observation, ``(1, size)`` each, from the measurements."""
    turn = _rotation(graph, measured["orientation"])
    parts = {
        "gravity": graph.apply("Neg", graph.picked(turn, 6, 7, 8)),
        "angular_velocity": measured["angular_velocity"],
        "joint_position": measured["joint_position"],
        "joint_velocity": measured["joint_velocity"],
        "feet": _feet(graph, measured["joint_position"], turn, table),
    }
    if "base_position" in measured:
        parts["base_height"] = graph.picked(measured["base_position"], 2)
        parts["linear_velocity"] = measured["linear_velocity"]
    return parts


def _rotation(graph: GraphBuilder, orientation: str) -> str:
    """``(1, 9)`` the matrix from the base frame to the world frame, row by row."""
    a, b, c, d = (graph.picked(orientation, *places) for places in (_A, _B, _C, _D))
    first = graph.apply("Mul", graph.apply("Mul", a, b), graph.constant(_FIRST[None]))
    second = graph.apply("Mul", graph.apply("Mul", c, d), graph.constant(_SECOND[None]))
    identity = graph.constant(np.eye(3).reshape(1, 9))
    return graph.apply("Add", graph.apply("Add", first, second), identity)


def _feet(graph: GraphBuilder, joints: str, turn: str, table: KinematicTable) -> str:
    """``(1, 8)`` x, y of the feet relative to the center of mass, in the heading frame."""
    feet, com = _feet_and_com(graph, joints, table)
    arms = graph.apply("Sub", feet, com)
    matrix = graph.shaped(turn, 3, 3)
    world = graph.apply("MatMul", arms, graph.apply("Transpose", matrix, perm=[1, 0]))
    forward = graph.picked(turn, 0, 3)
    square = graph.apply("ReduceSum", graph.apply("Mul", forward, forward), graph.integers(1))
    length = graph.apply("Sqrt", square)
    upright = graph.apply("Greater", length, graph.constant([[1e-9]]))
    # A base whose x axis is vertical has no heading; its yaw is set to 0.
    forward = graph.apply("Where", upright, forward, graph.constant([[1.0, 0.0]]))
    length = graph.apply("Where", upright, length, graph.constant([[1.0]]))
    heading = graph.apply("Div", forward, length)
    left = graph.apply("Mul", graph.picked(heading, 1, 0), graph.constant([[-1.0, 1.0]]))
    axes = graph.apply("Transpose", graph.joined([heading, left], axis=0), perm=[1, 0])
    level = graph.apply("MatMul", graph.picked(world, 0, 1), axes)
    return graph.shaped(level, 1, 2 * len(LEGS))


def _feet_and_com(graph: GraphBuilder, joints: str, table: KinematicTable) -> tuple[str, str]:
    """``(4, 3)`` the feet, and ``(1, 3)`` the center of mass, in the base frame."""
    arrays = table.arrays
    angles = graph.shaped(joints, len(LEGS), LEG_JOINTS, 1, 1)
    identity = graph.constant(np.eye(3)[None])
    one = graph.constant([[[1.0]]])
    columns = graph.constant(arrays.ends)
    for joint in reversed(range(LEG_JOINTS)):
        angle = graph.shaped(graph.picked(angles, joint), len(LEGS), 1, 1)
        skew = arrays.skew[:, joint]
        sine = graph.apply("Mul", graph.apply("Sin", angle), graph.constant(skew))
        rest = graph.apply("Sub", one, graph.apply("Cos", angle))
        rest = graph.apply("Mul", rest, graph.constant(skew @ skew))
        turn = graph.apply("Add", graph.apply("Add", identity, sine), rest)
        arms = graph.apply("Add", columns, graph.constant(arrays.arms[joint]))
        turned = graph.apply("MatMul", turn, arms)
        columns = graph.apply("Add", turned, graph.constant(arrays.centers[joint]))
    feet = graph.shaped(graph.picked(columns, 0, axis=2), len(LEGS), 3)
    links = graph.shaped(graph.picked(columns, 1, axis=2), len(LEGS), 3)
    legs = graph.apply("ReduceSum", links, graph.integers(0))
    return feet, graph.apply("Add", legs, graph.constant(arrays.base[None]))


def _goal(graph: GraphBuilder, policy: Policy, measured: Mapping[str, str]) -> list[str]:
    """The parts of the goal, float32 ``(1, size)`` each."""
    spec = policy.spec.observation
    table = spec.phases.reshape(-1, 2)
    command = graph.cast(measured["command"], SINGLE)
    if len(spec.gaits) == 1:
        row = graph.apply("Mod", measured["tick"], graph.integers(int(spec.periods[0])))
        one_hot = []
    else:
        gait = measured["gait"]
        period = graph.apply("Gather", graph.constant(spec.periods, np.int64), gait, axis=0)
        first = graph.apply("Mul", gait, graph.integers(spec.phases.shape[1]))
        row = graph.apply("Add", first, graph.apply("Mod", measured["tick"], period))
        places = graph.constant([range(len(spec.gaits))], np.int64)
        one_hot = [graph.cast(graph.apply("Equal", places, gait), SINGLE)]
    rows = graph.apply("Gather", graph.constant(table, np.float32), row, axis=0)
    return [graph.shaped(rows, 1, 2), command, *one_hot]


def _begun(graph: GraphBuilder, parts: Mapping[str, str], history: History) -> str:
    """``(1, reach, sample_size)`` the memory; where an episode begins, this sample repeated."""
    names = [*history.parts, "joint_position"] if history.targets else [*history.parts]
    first = graph.cast(graph.joined([parts[name] for name in names]), SINGLE)
    first = graph.shaped(first, 1, 1, history.sample_size)
    total = graph.apply("ReduceSum", graph.apply("Abs", MEMORY_IN), graph.integers(0, 1, 2))
    begins = graph.apply("Equal", total, graph.constant([[[0.0]]], np.float32))
    return graph.apply("Where", begins, first, MEMORY_IN)


def _network(graph: GraphBuilder, policy: Policy, inputs: str) -> str:
    """The joint targets ``(1, 12)`` of the network, float32."""
    model = network_model(policy)
    for node in model.graph.node:
        for place, name in enumerate(node.input):
            node.input[place] = inputs if name == INPUT else name
        for place, name in enumerate(node.output):
            node.output[place] = "network_target" if name == OUTPUT else name
        graph.nodes.append(node)
    graph.tensors.extend(model.graph.initializer)
    return "network_target"


def _applied(
    graph: GraphBuilder, target: str, measured: Mapping[str, str], description: PolicyDescription
) -> str:
    """``(1, 12)`` the targets that the motors can follow, which give the clipped torques."""
    kp = graph.constant([description.kp])
    limit = np.array([description.torque_limit])
    damping = graph.apply("Mul", graph.constant([description.kd]), measured["joint_velocity"])
    error = graph.apply("Sub", target, measured["joint_position"])
    torque = graph.apply("Sub", graph.apply("Mul", kp, error), damping)
    torque = graph.apply("Max", torque, graph.constant(-limit))
    torque = graph.apply("Min", torque, graph.constant(limit))
    shifted = graph.apply("Div", graph.apply("Add", torque, damping), kp)
    return graph.apply("Add", shifted, measured["joint_position"])


def _add_outputs(
    graph: GraphBuilder, description: PolicyDescription, inputs: str, target: str, size: int
) -> None:
    """Add the joint targets as exploy names them, and the network's input and output."""
    shape = (1, len(JOINTS))
    zeros = graph.constant(np.zeros(shape), np.float32)
    name = output_name(description)
    graph.output(f"{name}.pos", shape, target)
    graph.output(f"{name}.vel", shape, zeros)
    graph.output(f"{name}.effort", shape, zeros)
    graph.output(OUTPUT, shape, target)
    graph.output(INPUT, (1, size), inputs)
