"""Opening survey data files: bounded, inside the first file's folder, whatever the writing of their names."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from aquanav_tools.errors import InputError

MAX_FILE_BYTES = 20_000_000
"""The largest single file of a public cave survey has about 2 MB."""
MAX_TOTAL_BYTES = 100_000_000
MAX_FILES = 5000
MAX_DEPTH = 40
"""Of files included in files; Survex's own limit is that of open files."""


@dataclass(eq=False)
class SurveyFiles:
    """The files of one survey."""

    root: Path
    """The file that was asked for."""
    suffix: str
    """What an *include may leave out, such as .svx."""
    opened: list[Path] = field(default_factory=list)
    num_bytes: int = 0
    """Of all that was opened, each time that it was."""

    def text(self, path: Path) -> str:
        """Return a file's text.

        Raises:
            InputError: it is missing, too large, binary, or one too many.
        """
        if not path.is_file():
            raise InputError(f"There is no file {path}. Check the path.")
        self.opened.append(path)
        if len(self.opened) > MAX_FILES:
            raise InputError(
                f"{self.root} includes more than {MAX_FILES} files. A file may include itself; break that."
            )
        size = path.stat().st_size
        self.num_bytes += size
        if self.num_bytes > MAX_TOTAL_BYTES:
            raise InputError(
                f"{self.root} and the files that it includes have more than {MAX_TOTAL_BYTES:,} bytes. A file may be "
                "included again and again; break that."
            )
        if size > MAX_FILE_BYTES:
            raise InputError(f"{path} has {size:,} bytes; survey data has at most {MAX_FILE_BYTES:,}. Check the path.")
        content = path.read_bytes()
        if b"\0" in content:
            raise InputError(
                f"{path} is binary, not survey data. A processed survey must be named .3d. Check the path."
            )
        try:
            return content.decode("utf-8-sig")
        except UnicodeDecodeError:
            return content.decode("latin-1")  # older surveys predate UTF-8; only comments and names can suffer

    def find_included(self, name: str, parent: Path, where: str) -> Path:
        """Return the path of a file named in an include command.

        Raises:
            InputError: it does not exist, or lies outside the folder of the first file.
        """
        slashed = name.replace("\\", "/")
        candidates = [variant for base in (name, slashed, slashed.lower()) for variant in (base, base + self.suffix)]
        folder = self.root.resolve().parent
        for candidate in candidates:
            path = parent.parent / candidate
            if not path.is_file():
                continue
            if not path.resolve().is_relative_to(folder):
                raise InputError(
                    f"{where} includes {name}, which is outside {folder}. Files are read only from the folder of the "
                    "survey that was asked for. Move that survey to a folder above all that it includes."
                )
            return path
        raise InputError(f"{where} includes {name}, but there is no such file. Check its name and place.")
