"""What a part says of itself is read from its source, and is what an import would give."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from srl.runtime.contracts import registry
from srl.runtime.contracts.declared import declared
from srl.runtime.profile import library, profile


@pytest.mark.parametrize(
    ("group", "attributes"),
    [("drivers", ("summary", "gives", "takes")), ("controllers", ("summary",)), ("clearances", ("summary",))],
)
def test_every_part_is_described_as_its_class_says(group: str, attributes: tuple[str, ...]) -> None:
    for name in registry.names(group):
        part = registry.load(group, name, name)
        point = f"{part.__module__}:{part.__name__}"
        output = {attribute: getattr(part, attribute) for attribute in attributes}
        assert declared(point, attributes) == output, name
        assert registry.describe(group, name, attributes) == output


@pytest.mark.slow
def test_every_profile_is_summed_up_as_it_says() -> None:
    for name in library.shipped():
        assert library.summary(name) == profile.load(name)[0].summary


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of another's, which must not be imported."""
    monkeypatch.syspath_prepend(str(tmp_path))
    folder = tmp_path / f"plug_{tmp_path.name.replace('-', '_')}"
    folder.mkdir()
    (folder / "__init__.py").write_text("raise AssertionError('imported')\n")
    return folder


def test_names_bases_and_re_exports_are_followed(package: Path) -> None:
    (package / "words.py").write_text("LINE = 'a line'\nNAMES: tuple[str, ...] = ('a', 'b')\n")
    (package / "base.py").write_text("class Base:\n    summary = 'of the base'\n    takes = ()\n")
    (package / "part.py").write_text(
        f"from {package.name} import words\nfrom {package.name}.base import Base\n"
        f"from {package.name}.words import LINE\n"
        "class Part(Base):\n    gives = words.NAMES\n    links = (LINE, 'x')\n"
    )
    (package / "again.py").write_text(f"from {package.name}.part import Part as Other\n")
    output = declared(f"{package.name}.again:Other", ("summary", "gives", "takes", "links"))
    assert output == {"summary": "of the base", "gives": ("a", "b"), "takes": (), "links": ("a line", "x")}
    assert package.name not in sys.modules


@pytest.mark.parametrize(
    "source",
    [
        "class Part:\n    summary = 'a' + 'b'\n",
        "def f(c): return c\n@f\nclass Part:\n    summary = 'a'\n",
        "LINE = 'a'\nLINE = 'b'\nclass Part:\n    summary = LINE\n",
        "class Part:\n    pass\n",
        "class Part(\n",
        "import no_such_library\nclass Part:\n    summary = 'a'\n",
        "from srl.runtime.no_such_module import thing\nclass Part:\n    summary = 'a'\n",
    ],
)
def test_what_the_source_does_not_tell_is_left_to_the_import(source: str, package: Path) -> None:
    (package / "part.py").write_text(source)
    assert declared(f"{package.name}.part:Part", ("summary",)) is None


def test_a_library_that_is_missing_further_down_is_left_to_the_import(package: Path) -> None:
    (package / "part.py").write_text(f"from {package.name} import inner\nclass Part:\n    summary = 'a'\n")
    (package / "inner.py").write_text("")
    assert declared(f"{package.name}.part:Part", ("summary",)) == {"summary": "a"}
    other = package.parent / f"{package.name}_b"
    other.mkdir()
    (other / "__init__.py").write_text("")
    (other / "part.py").write_text(f"from {other.name}.inner import x\nclass Part:\n    summary = 'a'\n")
    (other / "inner.py").write_text("import no_such_library\n")
    assert declared(f"{other.name}.part:Part", ("summary",)) is None
