"""What a reader of a mesh collection says of each file before it is loaded, and how readers walk a folder."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from waveformer.simulator.mesh_formats import MESH_FORMATS

UpAxis = Literal["x", "y", "z"]
UP_AXES: tuple[UpAxis, ...] = ("x", "y", "z")

OUTSIDE = "leads out of the catalogue's folder: copy the file there, or scan the folder it lies in"
_MESH_ENDINGS = tuple(f".{name}" for name in MESH_FORMATS)
_UNPRINTABLE = "its name holds characters that cannot be printed: rename it"


@dataclass(frozen=True)
class CatalogItem:
    """One object of a collection, not yet loaded.

    Attributes:
        source: the collection.
        object_id: its name within the source.
        path: of the mesh file, relative to the root, with "/"; never absolute.
        category: "" where unknown.
        licence: "" where unknown.
        unit_m: metres per unit of the file; None where unknown.
        up_axis: of the file.
        expected_sha256: what the collection's own annotation says; None where it has none.
        notes: what the collection is known to be bad at here, one readable line each.
        reason: why it cannot be used whatever the file holds; "" if only loading can tell.
    """

    source: str
    object_id: str
    path: str
    category: str = ""
    licence: str = ""
    unit_m: float | None = None
    up_axis: UpAxis = "z"
    expected_sha256: str | None = None
    notes: tuple[str, ...] = ()
    reason: str = ""


Reader = Callable[[Path], Iterator[CatalogItem]]


@dataclass(frozen=True)
class FoundFile:
    """One file below a folder.

    Attributes:
        path: relative to the folder, with "/".
        reason: why it cannot be used, "" if nothing is known against it.
    """

    path: str
    reason: str = ""

    @property
    def parts(self) -> tuple[str, ...]:
        """The names along the path."""
        return tuple(self.path.split("/"))

    @property
    def name(self) -> str:
        """The last name of the path."""
        return self.path.rsplit("/", 1)[-1]

    @property
    def stem(self) -> str:
        """The last name without its extension."""
        return os.path.splitext(self.name)[0]

    @property
    def suffix(self) -> str:
        """The extension in lower case, without its dot."""
        return os.path.splitext(self.name)[1][1:].lower()


def walk_files(root: Path) -> Iterator[FoundFile]:
    """All files below a folder by name, files before folders; what is hidden (.name) is passed over.

    Linked folders are not entered: inside `root` they are found in their own place. What cannot be looked at
    (linked out of `root`, not to be listed, named unprintably) comes with its reason.
    """
    real_root = os.path.realpath(root)
    open_folders = [_listing(root, "")]
    while open_folders:
        found = next(open_folders[-1], None)
        if found is None:
            open_folders.pop()
        elif isinstance(found, FoundFile):
            yield found
        else:
            path = _relative(root, found)
            if found.is_symlink():
                if not is_inside(real_root, found.path):
                    yield FoundFile(path, OUTSIDE)
                continue
            if path.lower().endswith(_MESH_ENDINGS):
                yield FoundFile(path, "a folder, not a mesh file")
            open_folders.append(_listing(root, path))


def is_inside(real_root: str, path: str | os.PathLike[str]) -> bool:
    """Whether a path, links resolved, lies in a folder whose own links are resolved."""
    return os.path.realpath(path).startswith(real_root.rstrip("/") + "/")


def printable(text: str) -> str:
    """The text with line breaks, control characters and undecodable bytes written as escapes."""
    if text.isprintable():
        return text
    return "".join(
        sign if sign.isprintable() else sign.encode("unicode_escape").decode("ascii") for sign in text
    )


def _listing(root: Path, folder: str) -> Iterator[FoundFile | os.DirEntry[str]]:
    """The files of one folder, then its folders as they come from the system."""
    try:
        with os.scandir(root / folder) as listing:
            entries = sorted(listing, key=lambda entry: entry.name)
    except OSError as error:
        yield FoundFile(printable(folder), f"the folder cannot be listed ({error.strerror})")
        return
    folders = []
    for entry in entries:
        path = _relative(root, entry)
        if entry.name.startswith("."):
            continue
        if not path.isprintable():
            yield FoundFile(printable(path), _UNPRINTABLE)
        elif _is_folder(entry):
            folders.append(entry)
        elif entry.is_symlink() and (broken := _broken_link(entry.path)):
            yield FoundFile(path, broken)
        else:
            yield FoundFile(path)
    yield from folders


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False


def _broken_link(path: str) -> str:
    try:
        os.stat(path)
    except OSError as error:
        if error.errno == errno.ELOOP:
            return "a symbolic link that leads in a circle: remove it"
        return "a symbolic link that leads nowhere: remove it"
    return ""


def _relative(root: Path, entry: os.DirEntry[str]) -> str:
    return os.path.relpath(entry.path, root).replace(os.sep, "/")
