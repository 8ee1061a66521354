"""Generate the synchronous clients from the asynchronous ones: ``python tools/make_sync.py [--check]``.

A table lists the replacements in the source. ``__await__`` is omitted. Every ``get_x`` without arguments, together with
its ``put_x``, also becomes a property ``x``. With ``--check``, no file is changed; the exit code is 1 if a file is out
of date.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "src" / "orinkit"
PAIRS = [
    (source, source.parent.parent / "_sync" / source.name)
    for folder in ("client", "abh3/api")
    for source in sorted((PACKAGE / folder / "_async").glob("*.py"))
    if source.name != "__init__.py"
]

HEADER = '''"""The synchronous client: sends and waits in the thread of the caller; no hidden thread, no event loop.

Generated from ``{source}`` by ``tools/make_sync.py``: do not edit.
"""
'''

REPLACEMENTS = (
    (r"async def ", "def "),
    (r"async with ", "with "),
    (r"``async with``", "``with``"),
    (r"\bawait ", ""),
    (r"__aenter__", "__enter__"),
    (r"__aexit__", "__exit__"),
    (r"__aiter__", "__iter__"),
    (r"__anext__", "__next__"),
    (r"StopAsyncIteration", "StopIteration"),
    (r"\bAwaitable\[None\]", "None"),
    (r"import asyncio\n", "import threading\n"),
    (r"asyncio\.Lock\(\)", "threading.RLock()"),
    (r"\b_async\b", "_sync"),
    (r"\barun\b", "run"),
    (r"\barun_can\b", "run_can"),
    (r"\bacall\b", "call"),
    (r"\bacall_prepared\b", "call_prepared"),
    (r"\babreak_off\b", "break_off"),
    (r"\basend_close\b", "send_close"),
    (r"\basleep\b", "sleep"),
    (r"\batry_acquire\b", "try_acquire"),
    (r"(?m)^( +)for sample in (.*):\n +yield sample$", r"\1yield from \2"),
    (r"orinkit\.aio\.Async", "orinkit."),
    (r'@public\("orinkit\.aio"\)', '@public("orinkit")'),
    (r"transport\.aio_links", "transport.links"),
    (r"transport\.aio_keepalive", "transport.keepalive"),
    (r"can\.aio_shared_bus", "can.shared_bus"),
    (r"\bAsync([A-Z]\w*)", r"\1"),
    (
        r"several tasks may use one client\. A call that is cancelled or times out",
        "several threads may use one client. A call that times out",
    ),
    ("several tasks may use one driver", "several threads may use one driver"),
)


def properties(class_node: ast.ClassDef) -> str:
    """Return the source of the properties that correspond to the get_x and put_x methods of a class."""
    methods = {node.name: node for node in class_node.body if isinstance(node, ast.AsyncFunctionDef)}
    made = []
    for name, node in methods.items():
        if not name.startswith("get_") or len(node.args.args) != 1:
            continue
        attribute = name.removeprefix("get_")
        text = _indented(ast.get_docstring(node) or "")
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


def _indented(docstring: str) -> str:
    first, *more = docstring.split("\n")
    return "\n".join([first, *(line and f"        {line}" for line in more), "        "]) if more else first


def make(source: Path, used: set[str]) -> str:
    """Return the source of the synchronous module; add the replacements that occurred to ``used``."""
    original = source.read_text(encoding="utf-8")
    tree = ast.parse(original)
    lines = original.split("\n")
    for node in reversed([n for n in tree.body if isinstance(n, ast.ClassDef)]):
        assert node.end_lineno is not None
        extra = properties(node)
        if extra:
            lines[node.end_lineno : node.end_lineno] = ["", *extra.rstrip().split("\n")]
        for method in node.body:
            if isinstance(method, ast.FunctionDef) and method.name == "__await__":
                assert method.end_lineno is not None
                del lines[method.lineno - 1 : method.end_lineno + 1]
    docstring = tree.body[0].end_lineno
    assert docstring is not None
    text = "\n".join(lines[docstring:])
    for pattern, replacement in REPLACEMENTS:
        text, count = re.subn(pattern, replacement, text)
        if count:
            used.add(pattern)
    return _formatted(HEADER.format(source=source.name) + text, source)


def _formatted(text: str, path: Path) -> str:
    for command in (["check", "--fix", "--quiet", "--select", "I,F401"], ["format", "--quiet"]):
        ruff = [sys.executable, "-m", "ruff", *command, "--stdin-filename", str(path), "-"]
        text = subprocess.run(ruff, input=text, capture_output=True, text=True, check=True).stdout
    return text


def main() -> int:
    """Write the files, or with ``--check`` report those that are out of date."""
    used: set[str] = set()
    stale = []
    for source, target in PAIRS:
        text = make(source, used)
        if not target.exists() or target.read_text(encoding="utf-8") != text:
            stale.append(target.name)
            if "--check" not in sys.argv[1:]:
                target.write_text(text, encoding="utf-8")
    unused = [pattern for pattern, _ in REPLACEMENTS if pattern not in used]
    if unused:
        print(f"make_sync: {unused} no longer occur; remove them from the table", file=sys.stderr)
        return 1
    if stale and "--check" in sys.argv[1:]:
        print(f"{', '.join(stale)}: out of date. Try: make sync", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
