"""Make the synchronous client from the asynchronous one: ``python tools/make_sync.py [--check]``.

Words are replaced by a table; every ``get_x`` without arguments (and its ``put_x``) becomes a property ``x`` as well.
``--check`` changes nothing and fails when the file is not current.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

CLIENT = Path(__file__).parent.parent / "src" / "orinkit" / "client"
SOURCE, TARGET = CLIENT / "_async.py", CLIENT / "_sync.py"

HEADER = '''"""The synchronous client: the caller's own thread sends and waits; no hidden thread, no event loop.

Made from ``_async.py`` by ``tools/make_sync.py``: do not edit.
"""
'''

REPLACEMENTS = (
    (r"async def ", "def "),
    (r"async with ", "with "),
    (r"``async with``", "``with``"),
    (r"\bawait ", ""),
    (r"__aenter__", "__enter__"),
    (r"__aexit__", "__exit__"),
    (r"import asyncio\n", "import threading\n"),
    (r"asyncio\.Lock\(\)", "threading.RLock()"),
    (r"\barun\b", "run"),
    (r"transport\.aio_tcp", "transport.tcp"),
    (r"AsyncTcpLink\.connect\(", "TcpLink("),
    (r"\bAsync([A-Z]\w*)", r"\1"),
    (
        r"several tasks may use one client\. A call that is cancelled or times out",
        "several threads may use one client. A call that times out",
    ),
)


def properties(class_node: ast.ClassDef) -> str:
    """Return the properties that a class gets from its get_x and put_x methods."""
    methods = {node.name: node for node in class_node.body if isinstance(node, ast.AsyncFunctionDef)}
    made = []
    for name, node in methods.items():
        if not name.startswith("get_") or len(node.args.args) != 1:
            continue
        attribute = name.removeprefix("get_")
        text = ast.get_docstring(node) or ""
        result = ast.unparse(node.returns) if node.returns else "None"
        made.append(
            f'    @property\n    def {attribute}(self) -> {result}:\n        """{text}"""\n        return self.{name}()\n'
        )
        setter = methods.get(f"put_{attribute}")
        if setter is not None:
            kind = ast.unparse(setter.args.args[1].annotation or ast.Constant(None))
            made.append(
                f"    @{attribute}.setter\n    def {attribute}(self, new: {kind}) -> None:\n        self.put_{attribute}(new)\n"
            )
    return "\n".join(made)


def make() -> str:
    """Return the synchronous module's text."""
    source = SOURCE.read_text(encoding="utf-8")
    tree = ast.parse(source)
    lines = source.split("\n")
    for node in reversed([n for n in tree.body if isinstance(n, ast.ClassDef)]):
        extra = properties(node)
        if extra:
            assert node.end_lineno is not None
            lines[node.end_lineno : node.end_lineno] = ["", *extra.rstrip().split("\n")]
    text = "\n".join(lines)
    docstring = tree.body[0].end_lineno
    assert docstring is not None
    text = HEADER + text.split("\n", docstring)[-1]
    for pattern, replacement in REPLACEMENTS:
        text, count = re.subn(pattern, replacement, text)
        if not count:
            raise SystemExit(f"make_sync: {pattern!r} no longer occurs; take it out of the table")
    return _formatted(text)


def _formatted(text: str) -> str:
    for command in (["check", "--fix", "--quiet", "--select", "I"], ["format", "--quiet"]):
        ruff = [sys.executable, "-m", "ruff", *command, "--stdin-filename", str(TARGET), "-"]
        text = subprocess.run(ruff, input=text, capture_output=True, text=True, check=True).stdout
    return text


def main() -> int:
    """Write the file, or with --check say whether it is current."""
    text = make()
    if "--check" in sys.argv[1:]:
        if not TARGET.exists() or TARGET.read_text(encoding="utf-8") != text:
            print(f"{TARGET.name} is not current: run python tools/make_sync.py", file=sys.stderr)
            return 1
        return 0
    TARGET.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
