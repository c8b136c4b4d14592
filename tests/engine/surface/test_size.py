"""The surface solver does not grow: what it may hold at most, and what is wanted (issue 56), number by number."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3] / "engine" / "surface"
FILES = {path: ast.parse(path.read_text()) for path in sorted(ROOT.rglob("*.py"))}


def functions() -> Iterator[ast.FunctionDef]:
    """All but kernels, which take numbers and arrays one by one."""
    for tree in FILES.values():
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef) and not any(
                "jit" in ast.unparse(mark) for mark in node.decorator_list
            ):
                yield node


def lines() -> int:
    return sum(len(path.read_text().splitlines()) for path in FILES)


def module_constants() -> int:
    found = 0
    for tree in FILES.values():
        for node in tree.body:
            if isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names = [
                    name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name)
                ]
                found += sum(name.strip("_").isupper() for name in names)
    return found


def long_functions() -> int:
    return sum((node.end_lineno or 0) - node.lineno >= 60 for node in functions())


def functions_of_many_parameters() -> int:
    return sum(
        len(
            [
                arg
                for arg in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
                if arg.arg != "self"
            ]
        )
        > 8
        for node in functions()
    )


def wide_tuples_returned() -> int:
    def wide(node: ast.expr | None) -> bool:
        if not isinstance(node, ast.Subscript) or ast.unparse(node.value) != "tuple":
            return False
        items = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        return len(items) > 2

    return sum(wide(node.returns) for node in functions())


@pytest.mark.parametrize(
    ("count", "most", "wanted"),
    [
        (lines, 6929, 5000), (module_constants, 60, 60), (long_functions, 0, 0),
        (functions_of_many_parameters, 0, 0), (wide_tuples_returned, 0, 0),
    ],
)  # fmt: skip
def test_the_solver_is_no_larger_than_it_was(count, most: int, wanted: int) -> None:
    assert count() <= most, f"{wanted} are wanted: take something out before something goes in"


def test_no_folder_holds_more_than_twelve_files() -> None:
    folders = {path.parent for path in FILES}
    assert max(sum(path.parent == folder for path in FILES) for folder in folders) <= 12


def test_imports_run_in_no_circle() -> None:
    names = {
        ".".join(("engine.surface", *path.relative_to(ROOT).with_suffix("").parts)): path for path in FILES
    }
    needs = {
        name: {
            at
            for node in FILES[path].body  # what a function imports when it is called closes no circle
            if isinstance(node, ast.ImportFrom) and node.module
            for at in (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))
            if at in names and at != name
        }
        for name, path in names.items()
    }
    while free := [name for name, others in needs.items() if not others]:
        for name in free:
            del needs[name]
        for others in needs.values():
            others.difference_update(free)
    assert not needs
