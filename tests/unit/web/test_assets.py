"""Files of other projects: what is listed is there, and nothing else is taken for it."""

import io
import platform
import re
import shutil
import tarfile

import pytest

from bench.web import assets

LISTED, CACHE = assets.packages(), assets._cache()


def archive(path, **files):
    path.parent.mkdir(parents=True, exist_ok=True)
    with tarfile.open(path, "w:gz") as made:
        for name, content in files.items():
            member = tarfile.TarInfo(f"package/{name}")
            member.size = len(content)
            made.addfile(member, io.BytesIO(content))
    return assets._integrity(path.read_bytes())


@pytest.fixture
def registry(tmp_path, monkeypatch):
    """A registry in a folder with one package, and empty places for the files and for what was fetched before."""
    monkeypatch.setattr(assets, "REGISTRY", (tmp_path / "registry").as_uri())
    monkeypatch.setattr(assets, "VENDOR", tmp_path / "vendor")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "registry/thing/-/thing-1.0.0.tgz"
    integrity = archive(path, a=b"of the package", LICENSE=b"free")
    listed = {"name": "thing", "version": "1.0.0", "licence": "MIT", "integrity": integrity, "files": {"a": "a.js"}}
    monkeypatch.setattr(assets, "packages", lambda: [listed])
    return path


def test_listed_files_and_their_licences_are_put_in_place(registry):
    assert assets.lacking() == ["a.js"]
    assets.fetch()
    assert assets.lacking() == []
    assert (assets.VENDOR / "a.js").read_bytes() == b"of the package"
    assert (assets.VENDOR / "thing.LICENSE").read_bytes() == b"free"
    registry.unlink()
    assets.fetch()  # from what was fetched before


def test_another_content_is_refused(registry):
    archive(registry, a=b"of somebody else", LICENSE=b"free")
    with pytest.raises(assets.AssetError, match=r"expects sha512-.*it was not used"):
        assets.fetch()
    assert assets.lacking() == ["a.js"]


def test_without_a_network_it_says_what_to_do(registry):
    registry.unlink()
    with pytest.raises(assets.AssetError, match="with a network: make assets"):
        assets.fetch()


def test_every_package_has_an_exact_version_an_integrity_and_a_licence():
    listed = assets.packages()
    assert len(listed) >= 3
    for package in listed:
        assert re.fullmatch(r"\d+\.\d+\.\d+", package["version"])
        assert re.fullmatch(r"sha512-[A-Za-z0-9+/]{86}==", package["integrity"])
        assert package["licence"]
        assert package.get("files") or package["bundle"]


def part(registry, name, **files):
    """Put a package into the registry, as part of the bundle."""
    path = registry.parents[2] / name / "-" / f"{name.rpartition('/')[2]}-1.0.0.tgz"
    integrity = archive(path, LICENSE=b"free", **files)
    return {"name": name, "version": "1.0.0", "integrity": integrity, "bundle": "made.js"}


@pytest.fixture
def bundle(registry, tmp_path, monkeypatch):
    """A bundle of a scoped package with the real bundler, and the packages as they are listed."""
    inside = {"package.json": b'{"module": "index.js", "sideEffects": false}', "index.js": b"export let a = 7, b = 8"}
    (bundler,) = [dict(each) for each in LISTED if each.get("for") == f"bundling on {platform.machine()}"]
    cached = CACHE / assets._cached_as(bundler)
    listed = [part(registry, "@scope/thing", **inside), bundler]
    target = tmp_path / "cache/inertial-test-bench/npm" / cached.name
    target.parent.mkdir(parents=True)
    shutil.copy(cached, target)
    monkeypatch.setattr(assets, "packages", lambda: listed)
    monkeypatch.setattr(assets, "ENTRY", tmp_path / "entry.js")
    assets.ENTRY.write_text('export { a } from "@scope/thing";')
    return listed


def test_packages_are_joined_in_one_module_with_what_is_exported_alone(bundle):
    assert assets.lacking() == ["made.js"]
    assets.fetch()
    assert assets.lacking() == []
    made = (assets.VENDOR / "made.js").read_text()
    assert "7" in made
    assert "8" not in made
    assert "import" not in made
    assert {path.name for path in assets.VENDOR.iterdir()} == {"made.js", "scope-thing.LICENSE"}


def test_a_part_that_lacks_and_a_computer_without_a_bundler_are_named(bundle, monkeypatch):
    assets.ENTRY.write_text('export { a } from "other";')
    with pytest.raises(assets.AssetError, match=r'cannot be bundled .*"other"'):
        assets.fetch()
    monkeypatch.setattr(platform, "machine", lambda: "pdp11")
    with pytest.raises(assets.AssetError, match=r"no bundler for pdp11.*copy its"):
        assets.fetch()
    assert assets.lacking() == ["made.js"]


def test_the_files_of_the_pages_are_there():
    assert assets.lacking() == []
