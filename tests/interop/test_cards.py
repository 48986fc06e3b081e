"""Cards: what a dataset or a policy file is, for which gait, commands and gains."""

from dataclasses import replace
from pathlib import Path

from surefoot.interop.cards import PolicyUse, card_path, dataset_card, policy_card
from surefoot.interop.datasets.segments import Exported
from surefoot.learning.policy import load
from surefoot.runs.policies import PACKAGED_POLICY

USE = PolicyUse("A file.", ("It swims not.",), ("surefoot check trot.onnx",))


def test_the_card_says_how_a_target_acts_and_what_was_exported(dataset, walked, tmp_path):
    config, _ = walked
    exported = Exported(tmp_path, 4, 749, 1)
    card = dataset_card("Solo12", "Minari", config, dataset, exported, {"action": "targets"})
    assert "tau = 2 (a - q) - 0.1 dq/dt" in card
    assert "749 frames (0.7 s at 1 kHz)" in card
    assert dataset.hash in card
    assert "| `action` | targets |" in card
    assert "tags: [Minari, surefoot," in card and "LeRobot" not in card


def test_the_card_of_a_policy_says_for_what_it_is_and_how_to_check_it():
    card = policy_card(load(PACKAGED_POLICY), "trot.onnx", USE)
    assert card.startswith("---\npipeline_tag: robotics\n")
    assert "# trot.onnx\n" in card
    assert "the quadruped solo12" in card
    assert "Gait trot: period 500 ms, duty factor 0.6, phase offsets 0, 0.5, 0.5, 0" in card
    assert "vx 0 to 0.3 m/s, vy 0 to 0 m/s, yaw rate 0 to 0 rad/s" in card
    assert "tau = 2 (a - q) - 0.1 dq/dt" in card
    assert "Layout `full`, 47 numbers" in card
    assert '- method: `"behavior_cloning"`' in card
    assert "Nothing of it is known here." in card
    assert "- It swims not.\n" in card
    assert "```bash\nsurefoot check trot.onnx\n```" in card


def test_a_policy_of_unknown_origin_has_a_card_without_commands():
    policy = load(PACKAGED_POLICY)
    policy.provenance.clear()
    card = policy_card(policy, "trot.onnx", replace(USE, checks=()))
    assert "Its file does not say." in card
    assert "How to check it" not in card


def test_a_stream_has_no_card():
    assert card_path(Path("/dev/stdout")) is None
    assert card_path(Path("a/trot.onnx")) == Path("a/trot.onnx.md")
