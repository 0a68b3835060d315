"""nodes/ uses private parts of rclpy only in rclpy_patches/, whose guard checks them."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

NODES = Path(__file__).parents[2] / "nodes"
MODULES = [path for path in NODES.rglob("*.py") if path.parent.name != "rclpy_patches"]
RCLPYS = ("Node", "SingleThreadedExecutor")
"""Classes of rclpy from which classes of this project inherit."""
OWN = ("self", "cls", "os")


def private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def on_others(tree: ast.AST) -> Iterator[str]:
    """Yield the private attributes that are accessed on objects other than ``self``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and private(node.attr) and ast.unparse(node.value) not in OWN:
            yield ast.unparse(node)


def inherited(tree: ast.AST) -> Iterator[str]:
    """Yield the private attributes that a class uses and inherits from rclpy."""
    for kind in (n for n in ast.walk(tree) if isinstance(n, ast.ClassDef)):
        if any(ast.unparse(base) in RCLPYS for base in kind.bases):
            used = [n for n in ast.walk(kind) if isinstance(n, ast.Attribute) and ast.unparse(n.value) == "self"]
            own = {n.name for n in ast.walk(kind) if isinstance(n, ast.FunctionDef)}
            own |= {n.attr for n in used if isinstance(n.ctx, ast.Store)}
            yield from (f"{kind.name}.{n.attr}" for n in used if private(n.attr) and n.attr not in own)


def imported(tree: ast.AST) -> Iterator[str]:
    """Yield the private modules of rclpy that are imported."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("rclpy.impl", "rclpy._")):
            yield str(node.module)


def of_rclpy(source: str) -> list[str]:
    tree = ast.parse(source)
    return [*on_others(tree), *inherited(tree), *imported(tree)]


@pytest.mark.parametrize("module", MODULES, ids=lambda path: str(path.relative_to(NODES)))
def test_no_private_part_of_rclpy_is_used(module: Path) -> None:
    assert of_rclpy(module.read_text()) == []


def test_private_parts_in_patches_are_found() -> None:
    source = (NODES / "rclpy_patches" / "cycle_executor.py").read_text()
    found = of_rclpy(source)
    assert {"guard._executor_triggered", "CycleExecutor._guard", "rclpy.impl.implementation_singleton"} <= set(found)


def test_replaced_clock_is_found() -> None:
    """If our class had an attribute with the same name as a private attribute of rclpy, the use of rclpy's attribute
    would not be found. Our class must therefore use a different name."""
    assert of_rclpy("class Ours(Node):\n    def now(self):\n        return self._clock.now()\n") == ["Ours._clock"]
