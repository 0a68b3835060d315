"""What ROS parameter files say of one node: upstream's rules of whose entry counts."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, RootModel

from hal.yaml_file import load

ALL = "/**"
PARAMETERS = "ros__parameters"

Content = Mapping[str, Mapping[str, Any]]
"""A file as it is: node names (or patterns), below them ``ros__parameters``."""


class _Node(BaseModel):
    model_config = ConfigDict(extra="allow")
    ros__parameters: dict[str, Any] = {}


class _File(RootModel[dict[str, _Node]]):
    pass


def read_content(path: Path, error: type[Exception]) -> Content:
    """The whole file. Raises ``error`` with every mistake in its shape."""
    content: Content = load(path, _File, error).model_dump()
    return content


def parameters_of(content: Content, node: str) -> dict[str, Any]:
    """The parameters of ``node``, which is in no namespace: what is said of it alone wins over what is said of all."""
    general = content.get(ALL, {})
    found: dict[str, Any] = dict(general.get(PARAMETERS, {}))
    for said in (general.get(node), content.get(f"{ALL}/{node}"), content.get(node), content.get(f"/{node}")):
        if isinstance(said, Mapping):
            found |= said.get(PARAMETERS) or {}
    return found


def names(content: Content, node: str) -> bool:
    """Whether the file says anything of this very node."""
    return any(name in content for name in (node, f"/{node}", f"{ALL}/{node}")) or node in content.get(ALL, {})
