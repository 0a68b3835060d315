"""nodes/ uses private parts of rclpy in rclpy_patches/ only, where the guard stands before them."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

NODES = Path(__file__).parents[2] / "nodes"
MODULES = [path for path in NODES.rglob("*.py") if path.parent.name != "rclpy_patches"]
RCLPYS = ("Node", "SingleThreadedExecutor")
"""The classes of rclpy that ours inherit from."""
OWN = ("self", "cls", "os")


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def on_others(tree: ast.AST) -> Iterator[str]:
    """Private attributes of anything but ``self``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and private(node.attr) and ast.unparse(node.value) not in OWN:
            yield ast.unparse(node)


def inherited(tree: ast.AST) -> Iterator[str]:
    """Private attributes that a class uses and has from rclpy."""
    for kind in (n for n in ast.walk(tree) if isinstance(n, ast.ClassDef)):
        if any(ast.unparse(base) in RCLPYS for base in kind.bases):
            used = [n for n in ast.walk(kind) if isinstance(n, ast.Attribute) and ast.unparse(n.value) == "self"]
            own = {n.name for n in ast.walk(kind) if isinstance(n, ast.FunctionDef)}
            own |= {n.attr for n in used if isinstance(n.ctx, ast.Store)}
            yield from (f"{kind.name}.{n.attr}" for n in used if private(n.attr) and n.attr not in own)


def imported(tree: ast.AST) -> Iterator[str]:
    """Modules of rclpy that are its own affair."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("rclpy.impl", "rclpy._")):
            yield str(node.module)


def of_rclpy(source: str) -> list[str]:
    tree = ast.parse(source)
    return [*on_others(tree), *inherited(tree), *imported(tree)]


@pytest.mark.parametrize("module", MODULES, ids=lambda path: str(path.relative_to(NODES)))
def test_no_private_part_of_rclpy(module: Path) -> None:
    assert of_rclpy(module.read_text()) == []


def test_the_patches_would_be_found() -> None:
    source = (NODES / "rclpy_patches" / "cycle_executor.py").read_text()
    found = of_rclpy(source)
    assert {"guard._executor_triggered", "CycleExecutor._guard", "rclpy.impl.implementation_singleton"} <= set(found)


def test_a_clock_that_is_replaced_would_be_found() -> None:
    """An attribute that a class stores and rclpy has too cannot be told apart; so the node's own has another name."""
    assert of_rclpy("class Ours(Node):\n    def now(self):\n        return self._clock.now()\n") == ["Ours._clock"]
