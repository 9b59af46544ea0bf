"""Run folders: one process writes into one, and every file in it is whole or absent.

A command that writes results holds :meth:`RunFolder.locked` for as long as it runs, and says with
:meth:`RunFolder.claim` what the folder holds, so that another experiment cannot be resumed in it by mistake.
"""

from __future__ import annotations

import csv
import errno
import fcntl
import json
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from hpp_framework.utils.errors import ConfigError, HppError, reason

LOCK = ".lock"
"""Locked while a process writes into the folder; says which, and is removed in the end."""
LARGEST = 256 * 2**20
"""Bytes of a JSON file that is read: far more than any command writes."""
ANOTHER = "Choose another --out."
RESUME = "Finished episodes are kept; resume later."
ROOM = "Choose a folder that is writable and has room."

Compare = Callable[[Mapping[str, Any], Mapping[str, Any]], str]
"""Takes the record found and the one wanted; returns how they differ, empty if the run may resume."""


def load_json(file: Path) -> Any:
    """Return the content of a JSON file.

    Args:
        file: written by an earlier command.

    Raises:
        ConfigError: if the file is missing, unreadable, damaged, or larger than :data:`LARGEST`.
    """
    remedy = "Write it again, or choose another folder."
    try:
        with file.open("rb") as stream:
            content = stream.read(LARGEST + 1)
        if len(content) > LARGEST:
            raise ConfigError(f"'{file}' is damaged, it has more than {LARGEST} bytes. {remedy}")
        return json.loads(content.decode("utf-8"))
    except OSError as error:
        raise ConfigError(f"cannot read '{file}': {reason(error)}. {remedy}") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"'{file}' is damaged, it is no JSON: {error}. {remedy}") from error


def read_json(file: Path) -> dict[str, Any]:
    """Return the JSON object in a file.

    Args:
        file: written by an earlier command.

    Raises:
        ConfigError: as :func:`load_json`, or if the file holds no JSON object.
    """
    content = load_json(file)
    if not isinstance(content, dict):
        raise ConfigError(
            f"'{file}' is damaged, it holds no JSON object. Write it again, or choose another folder."
        )
    return content


@contextmanager
def replacing(
    file: Path, *, remedy: str = ANOTHER, failed: str = "", error: type[HppError] = ConfigError
) -> Generator[Path]:
    """Give a file or folder to write beside ``file``, whose place it takes in the end.

    It is on the disk before it takes that place. If anything goes wrong it is removed, and an earlier
    ``file`` is kept. Missing folders are made.

    Args:
        file: what is to be written.
        remedy: last sentence of the message, should it fail.
        failed: first words of that message, by default ``cannot write 'FILE'``.
        error: raised then.

    Raises:
        HppError: of the class ``error``, if it cannot be written.
    """
    temporary = file.with_name(f"{file.name}.tmp")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        if temporary.is_dir():  # a killed process left it
            shutil.rmtree(temporary)
        yield temporary
        for part in (*temporary.rglob("*"), temporary):
            _sync(part)
        temporary.replace(file)
        _sync(file.parent)
    except OSError as problem:
        what = failed or f"cannot write '{file}'"
        raise error(f"{what}: {reason(problem)}. {remedy}") from problem
    finally:
        with suppress(OSError):
            shutil.rmtree(temporary) if temporary.is_dir() else temporary.unlink(missing_ok=True)


def _sync(path: Path) -> None:
    """Wait until a file or folder is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    except OSError as problem:
        # some file systems cannot sync folders
        if not (path.is_dir() and problem.errno in (errno.EINVAL, errno.ENOTSUP)):
            raise
    finally:
        os.close(descriptor)


def write_text(
    file: Path, text: str, *, remedy: str = ANOTHER, failed: str = "", error: type[HppError] = ConfigError
) -> Path:
    """Write a text file, completely or not at all; options and errors as for :func:`replacing`."""
    return write_bytes(file, text.encode("utf-8"), remedy=remedy, failed=failed, error=error)


def write_bytes(
    file: Path,
    content: bytes,
    *,
    remedy: str = ANOTHER,
    failed: str = "",
    error: type[HppError] = ConfigError,
) -> Path:
    """Write a file, completely or not at all; options and errors as for :func:`replacing`."""
    with replacing(file, remedy=remedy, failed=failed, error=error) as temporary:
        temporary.write_bytes(content)
    return file


def write_json(
    file: Path, content: Any, *, indent: int | None = 2, remedy: str = ANOTHER, failed: str = "",
    error: type[HppError] = ConfigError,
) -> Path:  # fmt: skip
    """Write plain data as JSON, completely or not at all; options and errors as for :func:`replacing`."""
    text = json.dumps(content, indent=indent) + "\n"
    return write_text(file, text, remedy=remedy, failed=failed, error=error)


def write_csv(
    file: Path, columns: Sequence[str], rows: Iterable[Mapping[str, Any]], *, remedy: str = ANOTHER
) -> Path:
    """Write a table, completely or not at all; options and errors as for :func:`replacing`."""
    with (
        replacing(file, remedy=remedy) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as out,
    ):
        writer = csv.DictWriter(out, columns)
        writer.writeheader()
        writer.writerows(rows)
    return file


def differ(names: Iterable[str]) -> str:
    """Return what :data:`Compare` returns for names of entries that differ."""
    listed = ", ".join(names)
    return f"{listed} differ" if listed else ""


def _differing(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    return differ(key for key in wanted if found.get(key) != wanted[key])


@dataclass(frozen=True)
class RunFolder:
    """A folder that a command writes into (``--out``).

    Attributes:
        path: of the folder; made when it is first needed.
    """

    path: Path

    def claim(
        self,
        name: str,
        record: Mapping[str, Any],
        *,
        what: str,
        remedy: str,
        compare: Compare = _differing,
    ) -> None:
        """Write what the folder holds, or check that it holds the same.

        Args:
            name: of the file that says so.
            record: what it says; JSON-compatible.
            what: is in the folder, for messages, e.g. ``"experiment"``.
            remedy: last sentence of the message that refuses.
            compare: decides whether the record found may be resumed.

        Raises:
            ConfigError: if the folder holds something else, is damaged, or cannot be written to.
        """
        file, record = self.path / name, json.loads(json.dumps(record))
        if not file.exists():
            self.write_record(name, record)
        elif difference := compare(read_json(file), record):
            raise ConfigError(f"'{self.path}' holds another {what} ({difference}). {remedy}")

    def write_record(self, name: str, record: Mapping[str, Any]) -> None:
        """Write what the folder holds, whatever was in it.

        Raises:
            ConfigError: if the folder cannot be written to.
        """
        write_json(self.path / name, record, failed=f"cannot write to '{self.path}'")

    def check(self) -> None:
        """Make the folder.

        Raises:
            ConfigError: if it cannot be made and written to.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            probe = self.path / ".write-test"
            probe.write_text("x")
            probe.unlink()
        except OSError as problem:
            raise self._unwritable(problem) from problem

    @contextmanager
    def locked(self) -> Generator[None]:
        """Keep other processes from writing into the folder while the context lasts.

        The folder is made, and removed in the end if it is still empty. The lock ends with the process,
        however it ends. File systems that know no locks do without.

        Raises:
            ConfigError: if another process holds the lock, or the folder cannot be written to.
        """
        missing = [each for each in (self.path, *self.path.parents) if not each.exists()]
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            lock = self._lock()
        except OSError as problem:
            raise self._unwritable(problem) from problem
        try:
            yield
        finally:
            # removed before it is unlocked: no other process can have locked it
            (self.path / LOCK).unlink(missing_ok=True)
            lock.close()
            for each in missing:
                with suppress(OSError):
                    each.rmdir()

    def _lock(self) -> TextIO:
        """Return the open lock file."""
        file = self.path / LOCK
        while True:
            lock = file.open("a+", encoding="utf-8", errors="replace")
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                lock.seek(0)
                owner = "".join(filter(str.isprintable, lock.read(200))) or "another process"
                lock.close()
                raise ConfigError(
                    f"{owner} is writing into '{self.path}'. Wait for it to end, or choose another --out."
                ) from None
            except OSError as problem:
                if problem.errno not in (errno.ENOLCK, errno.ENOTSUP):
                    lock.close()
                    raise
            # its last owner may have removed it between opening and locking
            if file.exists() and os.path.samestat(os.fstat(lock.fileno()), file.stat()):
                break
            lock.close()
        lock.truncate(0)
        lock.write(f"process {os.getpid()} ({shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])})")
        lock.flush()
        return lock

    def _unwritable(self, problem: OSError) -> ConfigError:
        return ConfigError(f"cannot write to '{self.path}': {reason(problem)}. {ANOTHER}")
