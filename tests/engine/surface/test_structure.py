"""The solver stays as small as it has become: each number may fall and none may rise.."""

import ast
from collections.abc import Iterator
from pathlib import Path

import engine.surface

FOLDER = Path(engine.surface.__path__[0])
LINES = 7500  # aim 5 000
FILES = 12
CONSTANTS = 60
LONG, LONG_FUNCTIONS = 60, 6  # aim 0
PARAMETERS, MANY_PARAMETERS = 8, 15  # aim 0
TUPLES = 15  # of three and more that are returned; aim 0


def modules() -> Iterator[ast.Module]:
    for path in sorted(FOLDER.rglob("*.py")):
        yield ast.parse(path.read_text())


def functions() -> Iterator[ast.FunctionDef]:
    """All but kernels, which are written for the compiler."""
    for module in modules():
        for node in ast.walk(module):
            if isinstance(node, ast.FunctionDef) and "jit" not in "".join(
                map(ast.unparse, node.decorator_list)
            ):
                yield node


def test_it_has_no_more_lines_and_its_folders_no_more_files():
    assert sum(len(path.read_text().splitlines()) for path in FOLDER.rglob("*.py")) <= LINES
    for folder in [FOLDER, *(path for path in FOLDER.rglob("*") if path.is_dir())]:
        assert len(list(folder.glob("*.py"))) <= FILES


def test_it_has_no_more_module_constants():
    targets = [
        ast.unparse(node.targets[0] if isinstance(node, ast.Assign) else node.target)
        for module in modules()
        for node in module.body
        if isinstance(node, ast.Assign | ast.AnnAssign)
    ]
    assert sum(target.strip("()").isupper() for target in targets) <= CONSTANTS


def test_its_functions_are_no_longer_and_take_and_return_no_more():
    long, many, tuples = 0, 0, 0
    for one in functions():
        asked = [of.arg for of in (*one.args.posonlyargs, *one.args.args, *one.args.kwonlyargs)]
        long += (one.end_lineno or 0) - one.lineno >= LONG
        many += len([name for name in asked if name not in ("self", "cls")]) > PARAMETERS
        if isinstance(one.returns, ast.Subscript) and ast.unparse(one.returns.value) == "tuple":
            inner = one.returns.slice
            tuples += isinstance(inner, ast.Tuple) and len(inner.elts) > 2
    assert (long <= LONG_FUNCTIONS, many <= MANY_PARAMETERS, tuples <= TUPLES) == (True,) * 3, (
        long,
        many,
        tuples,
    )
