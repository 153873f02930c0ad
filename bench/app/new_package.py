"""Starter packages of plug-in drivers and methods, copied from working templates under another name."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from importlib.util import find_spec
from pathlib import Path

from bench.config.load import shipped
from bench.config.new_bench import expect_name
from bench.errors import InputError
from bench.files import atomic_folder
from bench.sequence.method import known_methods
from drivers.description import known_drivers
from drivers.schema.suggest import did_you_mean

_TOY = "toy_"
_LEFT_OUT = ("__pycache__", ".pytest_cache", ".mypy_cache", ".ruff_cache")


def expect_free(name: str, kind: str, known: Collection[str]) -> None:
    """Raise InputError for an invalid name, and for one that is in `known` of this kind or is a module."""
    expect_name(name)
    if name in known:
        raise InputError(f"NAME: there is a {kind} '{name}' already; choose another name")
    module = find_spec(name)
    if module is not None and module.origin is not None:  # a folder of that name here has no origin
        raise InputError(f"NAME: there is a Python module '{name}' already; choose another name")


def write_package(template: Path, name: str, out: Path) -> list[Path]:
    """Write the package `OUT/NAME`. Raises InputError if it cannot be written."""
    folder = out / name
    try:
        with atomic_folder(folder) as draft:
            made = [path.relative_to(draft) for path in _copied(template, draft, name)]
        return [folder / path for path in made]
    except FileExistsError:
        raise InputError(f"{folder}: is there already; choose another name, or remove it first") from None
    except OSError as problem:
        raise InputError(f"{folder}: cannot be written ({problem})") from None


def _copied(template: Path, folder: Path, name: str) -> Iterator[Path]:
    (toy,) = (path.name for path in template.iterdir() if path.name.startswith(_TOY))
    for source in sorted(template.rglob("*")):
        parts = source.relative_to(template).parts
        if source.is_dir() or any(part in _LEFT_OUT for part in parts):
            continue
        path = folder.joinpath(*(part.replace(toy, name) for part in parts))
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(_renamed(source.read_text("utf-8"), toy, name), "utf-8")
        yield path


def _renamed(text: str, toy: str, name: str) -> str:
    """Replace the names of the template in a text: package, distribution and classes."""
    for spell in (str, lambda words: words.replace("_", "-"), _camel):
        text = text.replace(spell(toy), spell(name))
    return text


def _camel(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_"))


def write_method(name: str, out: Path) -> list[Path]:
    """Write the package `OUT/NAME`. Raises InputError for an invalid or used name, and errors of writing."""
    expect_free(name, "method", known_methods())
    template = next(path for folder in shipped("templates") if (path := folder / "method").is_dir())
    return write_package(template, name, out)


def kinds() -> dict[str, Path]:
    """Return the templates, by the capability of the driver."""
    folders = [folder / "driver" for folder in shipped("templates")]
    return {path.name: path for folder in folders if folder.is_dir() for path in sorted(folder.iterdir())}


def write_driver(name: str, kind: str, out: Path) -> list[Path]:
    """Write the package `OUT/NAME`. Raises InputError for an invalid or used name, and errors of writing."""
    expect_free(name, "driver", known_drivers())
    if kind not in (known := kinds()):
        raise InputError(f"--kind {kind}: there is no template of this kind{did_you_mean(kind, known)}")
    return write_package(known[kind], name, out)
