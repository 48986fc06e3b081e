"""What tells one robot from another: its spec and the content of its description."""

from dataclasses import replace

from surefoot.config.robot_table import A1, GO2
from surefoot.robots.description import find_urdf
from surefoot.robots.identity import description_hash


def test_the_hash_is_that_of_the_content_wherever_it_lies(tmp_path):
    path = tmp_path / "mine.urdf"
    path.write_bytes(find_urdf(GO2).read_bytes())
    moved = replace(GO2, urdf=str(path))
    assert description_hash(moved) == description_hash(GO2)
    path.write_bytes(path.read_bytes() + b"\n")
    assert description_hash(moved) != description_hash(GO2)


def test_another_spec_has_another_hash():
    hashes = {description_hash(spec) for spec in (GO2, A1, replace(GO2, foot_radius=0.03))}
    assert len(hashes) == 3
