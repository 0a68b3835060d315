"""Files of a scene: included and attached scenes, meshes and textures. The size of each file is limited."""

from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element
from xml.parsers.expat import ExpatError

from drivers.paths import resolved
from hal.file_size import LARGEST_SHAPE_BYTES, REDUCE, check_size
from hal.hal_errors import ArmFileError
from hal.robot_description.xml_places import parse_xml, place
from hal.text_file import read_xml

INCLUDE: Final = "include"
MODEL: Final = "model"
"""Element that attaches another scene. File names in the attached scene are relative to the folder of that scene."""
FOLDERS: Final = ("assetdir", "meshdir", "texturedir")
"""Attributes of <compiler> that specify folders for files."""


def scene_parts(path: Path) -> list[Element]:
    """Read a scene and all scenes to which it refers, and check the sizes of all other files.

    Returns:
        Root elements of all scenes. The first root belongs to the scene itself.

    Raises:
        ArmFileError: A file is too large, or a scene is not well-formed XML. The message contains the file, the line
            and how to fix the problem.
    """
    return _Parts().read(path, path.parent)


class _Parts:
    """Files of one scene that have already been read."""

    def __init__(self) -> None:
        self._read: set[Path] = set()

    def read(self, path: Path, home: Path) -> list[Element]:
        """Read a scene and all scenes to which it refers. ``home`` is the folder to which file names are relative."""
        self._read.add(resolved(path))
        root = _parsed(path)
        homes = list(dict.fromkeys((home, path.parent)))
        roots = [root]
        for element in root.iter():
            if element.tag in (INCLUDE, MODEL) and "file" in element.attrib:
                for other in _existing(homes, [""], element.attrib["file"]):
                    roots += self._named(element, other, home)
        _check_sizes(roots, homes)
        return roots

    def _named(self, element: Element, path: Path, home: Path) -> list[Element]:
        """Return the scenes in the file to which an element refers, or no scenes if the file has already been read."""
        if resolved(path) in self._read:
            return []
        try:
            check_size(path, ArmFileError)
            return self.read(path, home if element.tag == INCLUDE else path.parent)
        except ArmFileError as error:
            raise ArmFileError(f"{place(element)}: {error}") from error


def _parsed(path: Path) -> Element:
    text = read_xml(path, ArmFileError, "the scene")
    try:
        return parse_xml(text, str(path))
    except ExpatError as error:
        raise ArmFileError(f"{path}: MuJoCo cannot read the scene, which is not well-formed XML: {error}") from error


def _check_sizes(roots: Sequence[Element], homes: Sequence[Path]) -> None:
    """Check the sizes of the files to which other elements refer: meshes, textures, height fields and skins."""
    elements = [element for root in roots for element in root.iter() if element.tag not in (INCLUDE, MODEL)]
    compilers = [element for element in elements if element.tag == "compiler"]
    folders = list(dict.fromkeys(["", *(one.attrib[key] for one in compilers for key in FOLDERS if key in one.attrib)]))
    for element in elements:
        for key, name in element.attrib.items():
            for path in _existing(homes, folders, name) if key.startswith("file") else ():
                try:
                    check_size(path, ArmFileError, LARGEST_SHAPE_BYTES, REDUCE)
                except ArmFileError as error:
                    raise ArmFileError(f"{place(element)}: {error}") from error


def _existing(homes: Sequence[Path], folders: Sequence[str], name: str) -> Iterator[Path]:
    """Yield the existing files that a name can refer to. The name is tried with its folders and, because of the option
    ``strippath``, without them."""
    names = dict.fromkeys((name, Path(name).name))
    paths = dict.fromkeys(home / folder / one for home, folder, one in product(homes, folders, names))
    yield from (path for path in paths if _is_file(path))


def _is_file(path: Path) -> bool:
    """Return whether the path is a file, a device or a pipe. If a name does not match any file, MuJoCo itself reports
    this error."""
    try:
        return path.exists() and not path.is_dir()
    except (OSError, ValueError):
        return False
