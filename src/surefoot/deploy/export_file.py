"""Reads exported files, and refuses those that must not run.

It first checks hash, version, robot, order of the joints, layout, and whether the graph fits them.
Read `policy` next, which runs what was read, and `description` for what a file says.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from surefoot.config.json_io import from_json
from surefoot.config.json_text import parse_json, read_file
from surefoot.deploy.description import (
    EXPORT_FORMAT,
    KEY,
    ExportFileError,
    PolicyDescription,
    file_hash,
)
from surefoot.errors import shown
from surefoot.learning.onnx_graph import open_session
from surefoot.types import JOINTS

MOST_BYTES = 300_000_000
"""[B] Maximum size of an exported file."""
_AGAIN = "copy it again, or export it again: `surefoot export POLICY --onnx FILE`"


@dataclass(frozen=True)
class ExportFile:
    """An exported file that has been checked.

    Attributes:
        path: Its path.
        content: Its bytes.
        description: Its description.
        metadata: All of its metadata, by key.
    """

    path: Path
    content: bytes
    description: PolicyDescription
    metadata: dict[str, str]


def read_export(
    path: Path | str, robot: str | None = None, layout: str | None = None
) -> ExportFile:
    """Read and check an exported file.

    Args:
        path: The file.
        robot: Name of the robot that it must be made for; None accepts any.
        layout: Name of the layout that it must have; None accepts any.

    Raises:
        FileNotFoundError: There is no such file.
        ExportFileError: It is truncated or changed, has another version, has a gait that no robot
            walks, or was made for another robot, another order of joints, or another layout; the
            message says what to do.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(
            f"there is no file {path}; `surefoot export POLICY --onnx` makes it"
        )
    if path.is_dir():
        raise ExportFileError(
            f"{path} is a folder, and no exported file; of the policy of a run, "
            f"`surefoot export {path} --onnx FILE` makes one"
        )
    content = _content(path)
    metadata = _metadata(path, content)
    if KEY not in metadata:
        raise ExportFileError(
            f"{path} does not say what it is (it has no key {KEY!r}): it was not exported by "
            "surefoot; export the policy with `surefoot export POLICY --onnx FILE`"
        )
    description = _description(path, content, metadata[KEY])
    try:
        _check_gaits(description)
        _check_made_for(description, metadata, robot, layout)
        if description.kind == "network":
            _check_sizes(description, content)
    except ValueError as error:
        raise ExportFileError(f"{path} {error}") from error
    return ExportFile(path, content, description, metadata)


def _content(path: Path) -> bytes:
    """The bytes of a file, if an exported file may be that large."""
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise ExportFileError(f"{path} has {size} bytes; at most {MOST_BYTES} are read")
    try:
        return read_file(path)
    except ValueError as error:
        raise ExportFileError(str(error)) from error


def _metadata(path: Path, content: bytes) -> dict[str, str]:
    """The metadata of a file."""
    try:
        return dict(open_session(content).get_modelmeta().custom_metadata_map)
    except ImportError:
        raise
    except Exception as error:  # whatever ONNX Runtime raises about a damaged file
        reason = " ".join(str(error).split())[:200]
        raise ExportFileError(f"{path} is not a whole ONNX file ({reason}); {_AGAIN}") from error


def _description(path: Path, content: bytes, text: str) -> PolicyDescription:
    """The description in a file's metadata, whose hash must match the file."""
    try:
        values = parse_json(text.encode())
    except ValueError as error:
        raise ExportFileError(f"{path}: its description is damaged ({error}); {_AGAIN}") from error
    version = values.get("format") if isinstance(values, dict) else None
    if isinstance(version, int) and version > EXPORT_FORMAT:
        raise ExportFileError(
            f"{path} has format {version}, which a newer version of surefoot has written, expected "
            f"{EXPORT_FORMAT}; update surefoot, or export the policy again with this version"
        )
    if version != EXPORT_FORMAT:
        raise ExportFileError(
            f"{path} has format {shown(version)}, expected {EXPORT_FORMAT}; {_AGAIN}"
        )
    try:
        stored = str(values.get("sha256"))
        if file_hash(content, stored) != stored:
            raise ValueError("its contents do not match their hash: it was changed or damaged")
        description = from_json(PolicyDescription, values, KEY)
    except ValueError as error:
        raise ExportFileError(f"{path}: {error}; {_AGAIN}") from error
    return description


def _check_gaits(description: PolicyDescription) -> None:
    """Check that a robot can walk each gait: `Gait` has narrower ranges than `GaitTiming`.

    Raises:
        ValueError: There is one that no robot can walk.
    """
    for timing in description.gaits:
        try:
            _ = timing.gait
        except ValueError as error:
            raise ValueError(
                f"has a gait {shown(timing.name)} that no robot walks: {error}; export the policy "
                "again"
            ) from error


def _check_made_for(
    description: PolicyDescription, metadata: dict[str, str], robot: str | None, layout: str | None
) -> None:
    """Check that a file was made for this robot, the order of `JOINTS` and this layout.

    Raises:
        ValueError: It was not.
    """
    if robot is not None and description.robot != robot:
        raise ValueError(
            f"is a policy of the robot {description.robot!r}, not of {robot!r}; export one that "
            f"was trained on {robot}"
        )
    joints = description.joints
    if joints != JOINTS:
        if sorted(joints) == sorted(JOINTS):
            place = next(i for i in range(12) if joints[i] != JOINTS[i])
            raise ValueError(
                "has the joints in another order than this version of surefoot: joint "
                f"{place} is {joints[place]}, and there {JOINTS[place]}; its weights belong to its "
                "own order, so do not rename them: send and take joints in the order of the file, "
                "or export the policy again"
            )
        raise ValueError(
            f"has other joints than this version of surefoot, {shown(joints)}, expected "
            f"{shown(JOINTS)}; export a policy that was trained on this robot"
        )
    if metadata.get("joint_names", ",".join(joints)) != ",".join(joints):
        raise ValueError(
            "names its joints twice, in different orders (`joint_names` and `surefoot`); export "
            "the policy again"
        )
    spec = description.spec
    if layout is not None and spec.layout.name != layout:
        raise ValueError(
            f"has the layout {spec.layout.name!r}, expected {layout!r}; export a policy that was "
            "trained with this layout"
        )


def _check_sizes(description: PolicyDescription, content: bytes) -> None:
    """Check that the graph of a network takes the described input, and returns twelve targets.

    Raises:
        ValueError: It does not.
    """
    session = open_session(content)
    sizes = [session.get_inputs(), session.get_outputs()]
    shapes = [[tensor.shape[-1:] for tensor in tensors] for tensors in sizes]
    expected = [[[description.spec.input_size]], [[len(JOINTS)]]]
    if shapes != expected:
        raise ValueError(
            f"has a graph of the sizes {shapes}, and describes {expected}; export it again"
        )
