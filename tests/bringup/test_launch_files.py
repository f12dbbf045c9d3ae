"""What launch files come to."""

import os
import re
from pathlib import Path

import pytest
import yaml

from roller_bringup import launching
from roller_bringup.launching import LaunchError, substitutions

NODE = '<node pkg="demo" exec="talker" name="{}"/>'


def load(world, body, **arguments):
    return launching.load(world.launch(body), arguments)


def files(process):
    """The parameter files of a process."""
    command = process.command
    return [command[i + 1] for i, word in enumerate(command) if word == "--params-file"]


def test_a_node_gets_the_arguments_launch_ros_gives(world):
    share = world.prefix / "share/demo"
    share.mkdir()
    (share / "p.yaml").write_text("/**: {ros__parameters: {}}\n")
    (world.files / "s.yaml").write_text("/**/chat: {ros__parameters: {speed: $(var speed)}}\n")
    plan = load(
        world,
        f"""
        <arg name="speed" default="0.5"/>
        <set_env name="EXTRA" value="1"/>
        <group>
        <push-ros-namespace namespace="ns"/>
        <node pkg="demo" exec="talker" name="chat" args="-a  --x=$(var speed)y $(env NO b)/c"
              output="screen">
          <param from="$(find-pkg-share demo)/p.yaml"/>
          <param from="{world.files}/s.yaml" allow_substs="true"/>
        </node>
        </group>
        """,
    )
    (process,) = plan.processes
    named, written = files(process)
    assert process.command == (
        *(str(world.prefix / "lib/demo/talker"), "-a", "--x=0.5y", "b/c"),
        *("--ros-args", "-r", "__node:=chat", "-r", "__ns:=/ns"),
        *("--params-file", str(share / "p.yaml"), "--params-file", written),
    )
    assert named == str(share / "p.yaml")
    content = yaml.safe_load(Path(written).read_text())
    assert content == {"/**/chat": {"ros__parameters": {"speed": 0.5}}}
    assert (process.env["EXTRA"], process.env["PATH"]) == ("1", os.environ["PATH"])
    assert (process.label, process.required) == ("ns/chat", False)
    plan.close()
    assert not Path(written).exists()


def test_groups_scope_and_conditions_choose(world):
    plan = load(
        world,
        """
        <arg name="on" default="true"/>
        <let name="where" value="outside"/>
        <group>
          <push-ros-namespace namespace="robot"/>
          <let name="where" value="inside"/>
          <set_env name="PLACE" value="inside"/>
          <group><push-ros-namespace namespace="arm"/>
            <node pkg="demo" exec="talker" name="a" args="$(var where)"/></group>
          <group><push-ros-namespace namespace="/"/>
            <node pkg="demo" exec="talker" name="r"/></group>
        </group>
        <group unless="$(var on)"><node pkg="demo" exec="talker" name="no"/></group>
        <node pkg="demo" exec="talker" name="b" args="$(var where) $(env PLACE none)"
              if="$(var on)"/>
        <node pkg="demo" exec="talker" name="c" if="0"/>
        """,
    )
    a, r, b = plan.processes
    assert (a.command[1], a.label, a.env["PLACE"]) == ("inside", "robot/arm/a", "inside")
    assert "__ns:=/robot/arm" in a.command
    assert r.label == "r"
    assert b.command[1:3] == ("outside", "none")
    assert not any("__ns" in word for word in b.command)
    assert "PLACE" not in b.env


def test_an_empty_namespace_is_none(world):
    (process,) = load(world, '<push-ros-namespace namespace=""/>' + NODE.format("a")).processes
    # As launch_ros has it.
    assert (process.label, process.command[-1]) == ("a", "__ns:=/")


def test_includes_and_arguments(world):
    part = world.launch(
        """
        <arg name="who"/><arg name="depth" default="1"/>
        <node pkg="demo" exec="talker" name="$(var who)" args="$(var depth)"/>
        """,
        "part.launch.xml",
    )
    body = f"""
        <arg name="name" default="bob" description="whose"/><arg name="must"/>
        <include file="{part}"><arg name="who" value="$(var name)"/></include>
        """
    (process,) = load(world, body, name="eve", depth="2", must="").processes
    assert (process.name, process.command[1]) == ("eve", "2")
    arguments = launching.list_arguments(world.files / "test.launch.xml")
    assert [(a.name, a.default, a.description) for a in arguments] == [
        ("name", "bob", "whose"),
        ("must", None, ""),
    ]
    with pytest.raises(LaunchError, match="no argument 'nam'; there are: depth, must, name, who"):
        load(world, body, nam="eve", must="")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ""),
        ("plain 'text', (with) $signs", "plain 'text', (with) $signs"),
        ("x$(var a)y$(env b)", "x<var:a>y<env:b>"),
        ("$(equals $(var a) b)", "<equals:<var:a>|b>"),
        ("$(file-content $(var a))", "<file-content:<var:a>>"),
        ("$(env A $(find-pkg-share p)/x.xml)", "<env:A|<find-pkg-share:p>/x.xml>"),
    ],
)
def test_substitutions(text, expected):
    assert substitutions.expand(text, lambda n, a: f"<{n}:{'|'.join(a)}>") == expected


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("$(eval 1 + 1)", "not supported; known are $(var)"),
        ("$()", "not supported"),
        ("$(var a", "not closed"),
        ("$(var)", "takes 1 arguments: $(var)"),
        ("$(equals a b c)", "takes 2 arguments"),
        ("$(env A 'b')", "' is not supported"),
        (r"a\$", r"\ is not supported"),
        ("$(var  a)", "takes 1 arguments"),
        ("$(env A " * 5000, "not closed"),
    ],
)
def test_substitutions_refused(text, reason):
    with pytest.raises(substitutions.SubstitutionError, match=re.escape(reason)):
        substitutions.expand(text, lambda n, a: "")


TALKER = "<node pkg='demo' exec='talker' name='a'"


@pytest.mark.parametrize(
    ("body", "line", "reason"),
    [
        ("<executable cmd='ls'/>", 2, "<executable> is not supported in <launch>"),
        (TALKER + " cwd='/'/>", 2, "attribute 'cwd'"),
        ("<node pkg='demo' name='a'/>", 2, "needs the attribute 'exec'"),
        ("<node pkg='demo' exec='walker' name='a'/>", 2, "'demo' has no executable 'walker'"),
        ("<node pkg='nope' exec='talker' name='a'/>", 2, "package 'nope' is not installed"),
        ("<node pkg='demo' exec='talker' name='a b'/>", 2, "can't be a node's name"),
        (TALKER + "/>\n" + TALKER + "/>", 3, "a second node is called a"),
        ("<push-ros-namespace namespace='1'/>", 2, "can't be a namespace"),
        (f"<push-ros-namespace namespace='{200 * 'n'}'/>", 2, "at most 180 characters, not 201"),
        (TALKER + " on_exit='restart'/>", 2, "'on_exit' can only be"),
        (TALKER + " sigterm_timeout='soon'/>", 2, "'sigterm_timeout' must be seconds"),
        (TALKER + " output='paper'/>", 2, "'output' must be"),
        (TALKER + " if='maybe'/>", 2, "'if' must be true or false"),
        (TALKER + " if='1' unless='0'/>", 2, "can't stand together"),
        (TALKER + " args='$(var x)'/>", 2, "there is no variable 'x'"),
        (TALKER + " args='\"x y\"'/>", 2, "quotes in 'args' are not supported"),
        ("<let name='a' value='$(env NOT_THERE)'/>", 2, "no environment variable 'NOT_THERE'"),
        ("<let name='a' value='$(dirname)'/>", 2, r"\$\(dirname \.\.\.\) is not supported"),
        ("<arg name='must'/>", 2, "'must' must be given: must:=VALUE"),
        ("<include file='no.launch.xml'/>", 2, "there is no launch file"),
        ("<group scoped='false'/>", 2, "attribute 'scoped'"),
        ("hello", 2, "unexpected text 'hello'"),
        ("<a></b>", 2, "not well-formed XML: mismatched tag"),
        ("<group>" * 100 + "</group>" * 100, 2, "nested too deeply"),
        (TALKER + ">\n<param from='/no.yaml'/></node>", 3, "there is no parameter file /no.yaml"),
        ("<let name='x' value='$(file-content /no.yaml)'/>", 2, "/no.yaml: can't be read"),
        (TALKER + ">\n<param name='p' value='1'/></node>", 3, "needs the attribute 'from'"),
        (TALKER + ">\n<remap from='a' to='b'/></node>", 3, "<remap> is not supported in <node>"),
        (
            TALKER + ">\n<param from='/dev/null' allow_substs='perhaps'/></node>",
            3,
            "no parameter file /dev/null",
        ),
    ],
)
def test_refuses_naming_file_and_line(world, body, line, reason):
    with pytest.raises(LaunchError, match=reason) as caught:
        load(world, body)
    assert caught.value.file == world.files / "test.launch.xml"
    assert caught.value.line == line
    assert str(caught.value).startswith(f"{world.files}/test.launch.xml:{line}: ")


def test_parameters_that_are_no_yaml_with_the_arguments_are_refused(world):
    (world.files / "s.yaml").write_text("/**/a: {ros__parameters: {b: '$(var b)'}}\n")
    body = f"<arg name='b'/>{TALKER}><param from='{world.files}/s.yaml' allow_substs='1'/></node>"
    assert load(world, body, b="two words: #").processes
    with pytest.raises(LaunchError, match="isn't YAML with these arguments in it"):
        load(world, body, b="a'b")


def test_files_that_include_each_other_end(world):
    path = world.files / "test.launch.xml"
    body = f"<arg name='a' default='1'/><include file='{path}'/>"
    with pytest.raises(LaunchError, match="launch files include each other without end"):
        load(world, body)
    with pytest.raises(LaunchError, match="launch files include each other without end"):
        launching.list_arguments(path)


def test_refuses_other_files(tmp_path):
    with pytest.raises(LaunchError, match="can't read the launch file: No such file"):
        launching.load(tmp_path / "none.launch.xml", {})
    other = tmp_path / "other.xml"
    for text, reason in (
        ("<robot/>", "starts with <launch>, not <robot>"),
        ("<launch/>", "nothing to start"),
        ("", "no element found"),
    ):
        other.write_text(text)
        with pytest.raises(LaunchError, match=reason):
            launching.load(other, {})


def test_an_executable_of_another_python_loses_the_bootstrap_mark(world, monkeypatch):
    monkeypatch.setenv("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "1")
    (process,) = load(world, NODE.format("a")).processes
    assert "_ROS_WHEELS_BOOTSTRAP_COMPLETE" not in process.env
