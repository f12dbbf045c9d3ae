"""Links by which ROS 2 finds a package: what lies in their place is somebody's, and stays."""

import shutil

import pytest


def package_in(folder):
    """A package to be linked."""
    package = folder / "src" / "demo"
    (package / "resource").mkdir(parents=True)
    (package / "resource" / "demo").touch()
    (package / "package.xml").write_text("<package/>")
    (package / "config").mkdir()
    return package


@pytest.mark.parametrize("name", ["config", "package.xml"])
def test_what_lies_where_a_link_belongs_stays_and_is_named(modules, tmp_path, name):
    package, share = package_in(tmp_path), tmp_path / "share"
    there = share / "demo" / name
    own = there / "cell.yaml" if name == "config" else there
    own.parent.mkdir(parents=True)
    own.write_text("measured: by hand")
    with pytest.raises(modules["steps"].SetupError, match=f"{there} is not of our making"):
        modules["wheels"].link_share(package, share)
    assert own.read_text() == "measured: by hand"
    there.rename(tmp_path / "away")
    modules["wheels"].link_share(package, share)
    assert there.is_symlink()


def test_a_share_that_is_the_package_itself_loses_nothing(modules, tmp_path):
    package, share = package_in(tmp_path), tmp_path / "share"
    share.mkdir()
    (share / "demo").symlink_to(package)
    with pytest.raises(modules["steps"].SetupError, match="move it away"):
        modules["wheels"].link_share(package, share)
    assert (package / "package.xml").read_text() == "<package/>"


def test_a_copy_where_a_link_belongs_is_replaced(modules, tmp_path):
    package, share = package_in(tmp_path), tmp_path / "share"
    (share / "demo").mkdir(parents=True)
    shutil.copy(package / "package.xml", share / "demo")
    modules["wheels"].link_share(package, share)
    assert (share / "demo" / "package.xml").is_symlink()


def test_links_make_a_package_visible_and_follow_a_move(modules, tmp_path):
    package = package_in(tmp_path)
    share = tmp_path / "share"
    (share / "demo" / "config").mkdir(parents=True)
    for _ in range(2):
        modules["wheels"].link_share(package, share)
        assert (share / "ament_index/resource_index/packages/demo").exists()
        assert (share / "demo" / "config").resolve() == package / "config"
