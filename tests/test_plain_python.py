"""The check of the style: bad snippets are reported with their line, good ones are not."""

import ast
import subprocess
import sys
from pathlib import Path

import plain_python
import pytest
from code_figures import figures

ROOT = Path(__file__).parent.parent


def reported_lines(rule, source):
    return [line for line, _ in rule(ast.parse(source))]


@pytest.mark.parametrize(
    "source",
    [
        "a, b = 1, 2",
        "a, b = x.q, y.v",
        "a, *b = x, *y",
        "self.a, self.b = a, b",
        "[a, b] = 1, 2",
        "c = a, b = 1, 2",
        "a, b = b, a + b",
    ],
)
def test_a_tuple_assignment_of_unrelated_values_is_reported(source):
    assert reported_lines(plain_python.tuple_assignments, f"\n{source}") == [2]


@pytest.mark.parametrize(
    "source",
    ["a, b = b, a", "x[i], x[j] = x[j], x[i]", "a, b = pair()", "shape = 1, 2", "a, b = x.shape"],
)
def test_a_swap_and_the_unpacking_of_one_value_are_not_reported(source):
    assert reported_lines(plain_python.tuple_assignments, source) == []


@pytest.mark.parametrize(
    "source", ["f(x := 1)", "f(a, b=(x := 1))", "f([y for y in (x := z)])", "f(g(x := 1))"]
)
def test_a_walrus_in_the_arguments_of_a_call_is_reported_once(source):
    assert reported_lines(plain_python.walruses, source) == [1]


@pytest.mark.parametrize("source", ["if (x := f()) is None: pass", "while x := f(y): pass"])
def test_a_walrus_in_a_condition_is_not_reported(source):
    assert reported_lines(plain_python.walruses, source) == []


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ('"""of the progress bar."""', [1]),
        ('"""Of loco_safe_dagger."""', [1]),
        ('"""Title.\n\nArgs:\n    seed: of the order.\n"""', [4]),
        ('"""Title.\n\nArgs:\n    kp, kd: of the PD law.\n"""', [4]),
        ('"""Title.\n\nArgs:\n    seed: Seed for the order of the samples.\n"""', []),
        ('"""A list of names."""', []),
        ('text = "of no docstring"', []),
    ],
)
def test_docstring_entries_that_begin_with_of_are_reported(source, lines):
    assert reported_lines(plain_python.fragments, source) == lines


def test_too_many_parameters_are_reported_and_self_does_not_count():
    names = ", ".join("abcdefgh")
    assert reported_lines(plain_python.long_signatures, f"def f({names}): ...") == []
    assert reported_lines(plain_python.long_signatures, f"def f(self, {names}): ...") == []
    assert reported_lines(plain_python.long_signatures, f"def f({names}, i): ...") == [1]
    assert reported_lines(plain_python.long_signatures, f"def f({names}, *, i=0): ...") == [1]


@pytest.mark.parametrize(
    "annotation", ["dict[str, Any]", "Mapping[str, object]", "typing.Mapping[str, Any]"]
)
def test_an_open_mapping_is_reported(annotation):
    assert reported_lines(plain_python.untyped, f"def f() -> {annotation}: ...") == [1]


@pytest.mark.parametrize("annotation", ["dict[str, float]", "dict[int, Any]", "Figures"])
def test_a_typed_result_is_not_reported(annotation):
    assert reported_lines(plain_python.untyped, f"def f() -> {annotation}: ...") == []


def test_a_file_at_the_json_edge_may_hold_some_open_mappings(tmp_path, monkeypatch):
    monkeypatch.setattr(plain_python, "PACKAGE", tmp_path)
    monkeypatch.setattr(plain_python, "UNTYPED", {"edge.py": 1})
    one = "x: dict[str, Any] = {}\n"
    for name, source, count in [("edge", one, 0), ("edge", 2 * one, 2), ("other", one, 1)]:
        module = tmp_path / f"{name}.py"
        module.write_text(source)
        assert len(plain_python.check_module(module)) == count


def test_a_long_module_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(plain_python, "PACKAGE", tmp_path)
    module = tmp_path / "long.py"
    module.write_text("x = 1\n" * 400)
    assert plain_python.check_module(module) == []
    module.write_text("x = 1\n" * 401)
    assert plain_python.check_module(module) == [(401, "401 lines, at most 400: split it by idea")]


def check_folder(folder):
    """Output and exit code of the check, run as `make check` runs it."""
    command = [sys.executable, str(ROOT / "checks" / "plain_python.py"), "."]
    child = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    return child.stdout, child.returncode


def test_the_program_names_file_and_line_and_fails(tmp_path):
    (tmp_path / "bad.py").write_text("x = 1\na, b = 1, 2\n")
    output, code = check_folder(tmp_path)
    assert output.startswith("bad.py:2: a tuple assignment")
    assert code == 1


def test_the_program_succeeds_on_plain_modules(tmp_path):
    (tmp_path / "good.py").write_text("a = 1\nb = 2\n")
    assert check_folder(tmp_path) == ("", 0)


def test_too_many_files_at_the_top_level_of_the_package_are_reported(tmp_path):
    package = tmp_path / "src" / "surefoot"
    package.mkdir(parents=True)
    for number in range(plain_python.TOP_LEVEL_FILES):
        (package / f"room_{number}.py").write_text("")
    assert check_folder(tmp_path) == ("", 0)
    (package / "one_more.py").write_text("")
    output, code = check_folder(tmp_path)
    most = plain_python.TOP_LEVEL_FILES
    assert output.startswith(f"src/surefoot: {most + 1} files, at most {most}")
    assert code == 1


def test_the_figures_of_a_checkout(tmp_path):
    package = tmp_path / "src" / "surefoot"
    package.mkdir(parents=True)
    (package / "module.py").write_text("def f(a, b, c, d, e, f, g):\n    x, y = a, b\n")
    contract = '[[tool.importlinter.contracts]]\ntype = "layers"\nlayers = ["a", "b | c"]\n'
    (tmp_path / "pyproject.toml").write_text(contract)
    counted = figures(tmp_path)
    assert counted["tuple assignments per 1000 lines"] == "500.0"
    assert counted["functions with more than 6 parameters"] == "1"
    assert counted["functions with more than 8 parameters"] == "0"
    assert counted["layers of the import contract"] == "2"
