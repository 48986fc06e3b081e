"""Output that lasts: failures are kept, the stream below is left as it was."""

import io
import sys

import pytest
from tqdm import tqdm

from surefoot.cli.streams import LastingStream, failure_of, lasting_output


def test_what_is_written_arrives_in_order_with_the_stream_below():
    buffer = io.BytesIO()
    stream = io.TextIOWrapper(buffer, "ascii")
    lasting = LastingStream(stream)
    lasting.write("10 m²\n")
    lasting.detach()
    stream.write("after")
    stream.flush()
    assert buffer.getvalue() == b"10 m\\xb2\nafter"


@pytest.mark.parametrize("is_terminal", [False, True])
def test_a_message_after_a_bar_begins_a_line_in_a_file(monkeypatch, is_terminal):
    buffer = io.BytesIO()
    below = io.TextIOWrapper(buffer, "utf-8", newline="")
    stream = LastingStream(below)
    monkeypatch.setattr(stream, "isatty", lambda: is_terminal)
    bar = tqdm(total=2, desc="walk", file=stream, leave=False)
    bar.update(1)
    bar.close()
    print("surefoot: no", file=stream)
    print("surefoot: more", file=stream)
    lines = buffer.getvalue().decode().replace("\r\n", "\n").split("\n")
    assert ("surefoot: no" in lines) != is_terminal
    assert "surefoot: more" in lines
    assert "" not in lines[:-1]


def test_the_first_failure_is_kept_and_the_rest_is_dropped(tmp_path):
    class Disk(io.BufferedWriter):
        full = False

        def flush(self) -> None:
            if self.full:
                raise OSError("disk full")
            super().flush()

    with (tmp_path / "out").open("wb", buffering=0) as raw:
        disk = Disk(raw)
        stream = io.TextIOWrapper(disk, "utf-8")
        lasting = LastingStream(stream)
        lasting.write("kept\n")
        disk.full = True
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("os.dup2", lambda nowhere, here: setattr(disk, "full", False))
            assert lasting.write("lost\n") == 5
        assert str(failure_of(lasting)) == "disk full"
        lasting.detach()


def test_the_streams_of_the_process_are_given_back(capsys):
    before = (sys.stdout, sys.stderr)
    with lasting_output() as output:
        assert sys.stdout is output
        print("10 m²")
        print("error", file=sys.stderr)
        assert failure_of(output) is None
    assert (sys.stdout, sys.stderr) == before
    assert capsys.readouterr() == ("10 m²\n", "error\n")


def test_streams_that_are_closed_or_no_files_are_no_error(monkeypatch):
    text = io.StringIO()
    monkeypatch.setattr("sys.stdout", None)
    monkeypatch.setattr("sys.stderr", text)
    with lasting_output() as output:
        print("nowhere")
        print("here", file=sys.stderr)
        assert failure_of(output) is None
    assert sys.stdout is None
    assert text.getvalue() == "here\n"
