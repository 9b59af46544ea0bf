"""Files of run folders: whole or absent, by one process at a time, with messages that say why not."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys

import pytest

from hpp_framework.cli.main import main
from hpp_framework.utils import run_folder
from hpp_framework.utils.errors import CheckpointError, ConfigError, reason
from hpp_framework.utils.run_folder import (
    LOCK,
    RunFolder,
    load_json,
    read_json,
    replacing,
    write_csv,
    write_json,
    write_text,
)

HOLD = """
import sys, time
from pathlib import Path
from hpp_framework.utils.run_folder import RunFolder
with RunFolder(Path(sys.argv[1])).locked():
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    """Start another process that writes into the folder ``out``; returns it."""
    command = [sys.executable, "-c", HOLD, str(tmp_path / "out")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()


def test_a_second_process_is_refused_and_told_of_the_first(holder, tmp_path, capsys):
    out = tmp_path / "out"
    command = ["evaluate", "--worlds", "simple", "--planners", "centralized-mp", "--episodes", "1", "--out"]
    with pytest.raises(SystemExit) as stop:
        main([*command, str(out)])
    assert stop.value.code == 2
    message = capsys.readouterr().err
    assert f"process {holder.pid} (" in message
    assert f"is writing into '{out}'" in message
    assert "choose another --out" in message
    assert [file.name for file in out.iterdir()] == [LOCK]


def test_a_killed_process_leaves_no_lock(holder, tmp_path):
    holder.kill()
    holder.wait()
    assert (tmp_path / "out" / LOCK).exists()
    with RunFolder(tmp_path / "out").locked():
        assert f"process {os.getpid()}" in (tmp_path / "out" / LOCK).read_text()
    assert not (tmp_path / "out" / LOCK).exists()


def test_a_lock_keeps_what_was_written_and_removes_what_stayed_empty(tmp_path):
    with RunFolder(tmp_path / "a" / "b").locked():
        pass
    assert list(tmp_path.iterdir()) == []
    with RunFolder(tmp_path / "a").locked():
        write_text(tmp_path / "a" / "kept", "x")
    assert [file.name for file in (tmp_path / "a").iterdir()] == ["kept"]


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.ENOTSUP])
def test_a_file_system_without_locks_does_without(code, tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(code, "no locks")

    monkeypatch.setattr(run_folder.fcntl, "flock", refuse)
    with RunFolder(tmp_path / "out").locked():
        write_text(tmp_path / "out" / "kept", "x")


def test_a_folder_that_cannot_be_written_to_is_named(tmp_path):
    (tmp_path / "taken").write_text("")
    for folder in (tmp_path / "taken", tmp_path / "taken" / "below"):
        with pytest.raises(ConfigError, match=f"cannot write to '{folder}': .* Choose"):
            RunFolder(folder).check()
        with (
            pytest.raises(ConfigError, match=f"cannot write to '{folder}': .* Choose"),
            RunFolder(folder).locked(),
        ):
            pass


def test_an_interrupted_write_keeps_the_earlier_file(tmp_path):
    file = write_json(tmp_path / "new" / "a.json", {"a": 1})

    def interrupted():
        with replacing(file) as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert json.loads(file.read_text()) == {"a": 1}
    assert list(file.parent.iterdir()) == [file]


def test_a_folder_takes_its_place_as_a_whole(tmp_path):
    stale = tmp_path / "chunk.tmp"
    stale.mkdir()
    (stale / "old").write_text("")
    with replacing(tmp_path / "chunk") as temporary:
        temporary.mkdir()
        (temporary / "new").write_text("")
        assert not (tmp_path / "chunk").exists()
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*")) == [
        "chunk", "chunk/new",
    ]  # fmt: skip


def test_a_file_is_on_the_disk_before_it_takes_its_place(tmp_path, monkeypatch):
    file, synced = write_text(tmp_path / "a.txt", "old"), []
    monkeypatch.setattr(run_folder, "_sync", lambda path: synced.append((path.name, file.read_text())))
    write_text(file, "new")
    assert synced == [("a.txt.tmp", "old"), (tmp_path.name, "new")]


@pytest.mark.parametrize(
    ("error", "why"),
    [(OSError(28, "No space left"), "No space left"), (OSError("odd"), "odd"), (OSError(), "OSError")],
)
def test_no_message_ends_in_none(error, why, tmp_path):
    assert reason(error) == why
    with (
        pytest.raises(CheckpointError, match=rf"cannot write '.*a.csv': {why}. Free space.$"),
        replacing(tmp_path / "a.csv", remedy="Free space.", error=CheckpointError),
    ):
        raise error
    with (
        pytest.raises(ConfigError, match=rf"^film could not be written: {why}. Choose another --out.$"),
        replacing(tmp_path / "a.mp4", failed="film could not be written"),
    ):
        raise error


def test_json_that_is_too_large_or_too_deep_is_refused(tmp_path, monkeypatch):
    deep = tmp_path / "deep.json"
    deep.write_text("[" * 200_000)
    with pytest.raises(ConfigError, match="deep.json' is damaged, .* Write it again"):
        load_json(deep)
    monkeypatch.setattr(run_folder, "LARGEST", 10)
    assert read_json(write_text(tmp_path / "a.json", '{"a": 12}\n')) == {"a": 12}
    with pytest.raises(ConfigError, match="a.json' is damaged, it has more than 10 bytes. Write it again"):
        read_json(write_text(tmp_path / "a.json", '{"a": 123}\n'))


def test_tables_have_their_columns_in_order(tmp_path):
    file = write_csv(tmp_path / "a.csv", ["b", "a"], [{"a": 1, "b": "x,y"}, {"a": None, "b": "z"}])
    assert file.read_bytes() == b'b,a\r\n"x,y",1\r\nz,\r\n'


def test_a_folder_is_claimed_once(tmp_path):
    folder = RunFolder(tmp_path / "out")
    options = {"what": "census", "remedy": "Go elsewhere."}
    folder.claim("record.json", {"seed": 1, "size": (2, 3), "of": "a"}, **options)
    folder.claim("record.json", {"seed": 1, "size": [2, 3]}, **options)
    with pytest.raises(ConfigError, match=r"out' holds another census \(seed, size differ\). Go elsewhere.$"):
        folder.claim("record.json", {"seed": 2, "size": (3, 3), "of": "a"}, **options)
    folder.claim("record.json", {"seed": 2}, compare=lambda found, wanted: "", **options)
    assert read_json(tmp_path / "out" / "record.json")["seed"] == 1
