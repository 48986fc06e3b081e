"""Pages of Markdown: generated text is replaced, and the prose around it stays."""

import pytest

from surefoot.study.markdown_text import BEGIN, END, page_with, write_page


def test_prose_around_the_tables_stays(tmp_path):
    path = tmp_path / "methods.md"
    assert page_with("| a |", path) == f"{BEGIN}\n| a |\n{END}\n"
    path.write_text(f"# Methods\n\n{BEGIN}\nold\n{END}\n\nAfter.\n")
    assert page_with("new", path) == f"# Methods\n\n{BEGIN}\nnew\n{END}\n\nAfter.\n"
    write_page("new", path)
    assert page_with("new", path) == path.read_text()


def test_a_page_may_have_the_tables_of_several_studies(tmp_path):
    path = tmp_path / "which.md"
    first = "<!-- table of regimes -->"
    second = "<!-- table of sensors -->"
    path.write_text(f"{first}\nfirst\n{END}\n\n{second}\n{END}\nAfter.\n")
    path.write_text(page_with("second", path, "sensors"))
    path.write_text(page_with("new first", path, "regimes"))
    written = f"{first}\nnew first\n{END}\n\n{second}\nsecond\n{END}\nAfter.\n"
    assert path.read_text() == written
    with pytest.raises(ValueError, match=r"put the lines <!-- table of other --> and"):
        page_with("third", path, "other")


def test_a_page_of_one_study_needs_no_name(tmp_path):
    path = tmp_path / "paper.md"
    path.write_text(f"{BEGIN}\n{END}\n")
    assert page_with("new", path, "paper") == f"{BEGIN}\nnew\n{END}\n"


@pytest.mark.parametrize("text", ["prose", f"{BEGIN} open", f"{END}{BEGIN}"])
def test_a_page_without_a_place_for_the_tables_is_an_error(tmp_path, text):
    path = tmp_path / "methods.md"
    path.write_text(text)
    with pytest.raises(ValueError, match="no place for the tables"):
        page_with("new", path)
