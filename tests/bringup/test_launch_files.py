"""What launch files come to."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest
import yaml

from roller_bringup import launching
from roller_bringup.launching import LaunchError, parameters


def load(world, body, **arguments):
    return launching.load(world.launch(body), arguments)


def written(process):
    """The parameter files of a process, parsed."""
    command = process.command
    return [
        yaml.safe_load(Path(command[i + 1]).read_text())
        for i, word in enumerate(command)
        if word == "--params-file"
    ]


def test_a_node_gets_the_arguments_launch_ros_gives(world):
    (world.files / "p.yaml").write_text("/**: {ros__parameters: {}}\n")
    plan = load(
        world,
        """
        <arg name="speed" default="0.5"/>
        <node pkg="demo" exec="talker" name="chat" namespace="ns" args="-a 'b c' --x=$(var speed)"
              output="screen">
          <remap from="in" to="/out"/>
          <param from="$(dirname)/p.yaml"/>
          <param name="speed" value="$(var speed)"/>
          <env name="EXTRA" value="1"/>
        </node>
        """,
    )
    (process,) = plan.processes
    command = list(process.command)
    assert command[0] == str(world.prefix / "lib/demo/talker")
    files = [command[i + 1] for i, word in enumerate(command) if word == "--params-file"]
    assert command[1:] == [
        *("-a", "b c", "--x=0.5", "--ros-args", "-r", "__node:=chat", "-r", "__ns:=/ns"),
        *("--params-file", str(world.files / "p.yaml"), "--params-file", files[1]),
        *("-r", "in:=/out"),
    ]
    assert written(process)[1] == {"/ns/chat": {"ros__parameters": {"speed": 0.5}}}
    assert process.env["EXTRA"] == "1"
    assert process.env["PATH"] == os.environ["PATH"]
    assert (process.name, process.required, process.respawn) == ("chat", False, False)
    plan.close()
    assert not Path(files[1]).exists()


def test_without_a_name_parameters_are_for_any_node(world):
    (process,) = load(
        world, '<node pkg="demo" exec="talker"><param name="a" value="1"/></node>'
    ).processes
    assert written(process) == [{"/**": {"ros__parameters": {"a": 1}}}]
    assert process.name == "talker"
    assert "-r" not in process.command


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("1", None, 1),
        ("1.0", None, 1.0),
        ("true", None, True),
        ("text", None, "text"),
        ("'1'", None, "1"),
        ("", None, ""),
        ("[1, 2]", None, [1, 2]),
        ("[a, b]", "yaml", ["a", "b"]),
        ("1", "str", "1"),
        ("1", "float", 1.0),
        ("1", "bool", True),
        ("[1.5, 2.0]", "list_of_float", [1.5, 2.0]),
    ],
)
def test_parameter_types(text, kind, value):
    found = parameters.convert(text, kind)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("{a: 1}", None),
        ("[1, a]", None),
        ("[]", None),
        ("2020-01-01", None),
        ("a: [", None),
        ("x", "int"),
        ("2", "bool"),
        ("[1]", "list_of_float"),
        ("1", "double"),
    ],
)
def test_parameter_types_refused(text, kind):
    with pytest.raises(ValueError, match=re.escape(repr(text)) if kind != "double" else "double"):
        parameters.convert(text, kind)


def test_nested_parameters_are_joined_with_dots(world):
    (process,) = load(
        world,
        """
        <node pkg="demo" exec="talker" name="n">
          <param name="a"><param name="b" value="1"/><param name="c" value="x" type="str"/></param>
        </node>
        """,
    ).processes
    assert written(process) == [{"/n": {"ros__parameters": {"a.b": 1, "a.c": "x"}}}]


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
        </group>
        <group scoped="false" unless="$(var on)"><let name="where" value="nowhere"/></group>
        <node pkg="demo" exec="talker" name="b" args="$(var where) $(env PLACE none)"
              if="$(var on)"/>
        <node pkg="demo" exec="talker" name="c" if="0"/>
        """,
    )
    a, b = plan.processes
    assert a.command[1] == "inside"
    assert "__ns:=/robot/arm" in a.command
    assert a.env["PLACE"] == "inside"
    assert b.command[1:3] == ("outside", "none")
    assert not any("__ns" in word for word in b.command)
    assert "PLACE" not in b.env


def test_a_condition_compares_an_argument(world):
    body = """
        <arg name="method" default=""/>
        <node pkg="demo" exec="talker" name="a" if="$(equals $(var method) surface)"/>
        <node pkg="demo" exec="talker" name="b" unless="$(equals $(var method) surface)"/>
        <node pkg="demo" exec="talker" name="c" args="$(equals 1 true)"/>
        """
    assert [process.name for process in load(world, body).processes] == ["b", "c"]
    a, c = load(world, body, method="surface").processes
    assert (a.name, c.command[1]) == ("a", "true")


def test_includes_and_arguments(world):
    world.launch(
        """
        <arg name="who"/><arg name="depth" default="1"/>
        <node pkg="demo" exec="talker" name="$(var who)" args="$(var depth) $(dirname)"/>
        """,
        "part.launch.xml",
    )
    body = """
        <arg name="name" default="bob" description="whose">
          <choice value="bob"/><choice value="eve"/>
        </arg>
        <include file="$(dirname)/part.launch.xml"><arg name="who" value="$(var name)"/></include>
        """
    (process,) = load(world, body, name="eve", depth="2").processes
    assert process.name == "eve"
    assert process.command[1:3] == ("2", str(world.files))
    arguments = launching.list_arguments(world.files / "test.launch.xml")
    assert [(a.name, a.default, a.choices) for a in arguments] == [
        ("name", "bob", ("bob", "eve")),
        ("depth", "1", ()),
    ]
    with pytest.raises(LaunchError, match="'name' must be one of bob, eve, not 'joe'"):
        load(world, body, name="joe")
    with pytest.raises(LaunchError, match="no argument 'nam'; there are: depth, name, who"):
        load(world, body, nam="eve")


def test_two_nodes_of_one_name_are_told_apart(world):
    node = '<node pkg="demo" exec="talker" name="a"/>'
    assert [p.name for p in load(world, node + node).processes] == ["a", "a-2"]


@pytest.mark.parametrize(
    ("body", "line", "reason"),
    [
        ("<executable cmd='ls'/>", 2, "<executable> is not supported in <launch>"),
        ("\n<node pkg='demo' exec='talker' cwd='/'/>", 2, "attribute 'cwd'"),
        ("<node pkg='demo'/>", 2, "needs the attribute 'exec'"),
        ("<node pkg='demo' exec='walker'/>", 2, "package 'demo' has no executable 'walker'"),
        ("<node pkg='nope' exec='talker'/>", 2, "package 'nope' is not installed"),
        ("<node pkg='demo' exec='talker' name='a b'/>", 2, "can't be a node's name"),
        ("<node pkg='demo' exec='talker' namespace='1'/>", 2, "can't be a namespace"),
        ("<node pkg='demo' exec='talker' on_exit='restart'/>", 2, "'on_exit' can only be"),
        ("<node pkg='demo' exec='talker' output='paper'/>", 2, "'output' must be one of"),
        ("<node pkg='demo' exec='talker' if='maybe'/>", 2, "'if' must be true or false"),
        ("<node pkg='demo' exec='talker' if='1' unless='0'/>", 2, "can't stand together"),
        ("<node pkg='demo' exec='talker' respawn_delay='-1'/>", 2, "number of seconds"),
        ("<node pkg='demo' exec='talker' args='$(var x)'/>", 2, "there is no variable 'x'"),
        ("<node pkg='demo' exec='talker' args='\"'/>", 2, "args: No closing quotation"),
        ("<let name='a' value='$(env NOT_THERE)'/>", 2, "no environment variable 'NOT_THERE'"),
        ("<let name='a' value='$(eval 1)'/>", 2, r"\$\(eval \.\.\.\) is not supported"),
        ("<arg name='must'/>", 2, "'must' must be given: must:=VALUE"),
        ("<include file='$(dirname)/no.launch.xml'/>", 2, "there is no launch file"),
        ("<include file='$(dirname)/test.launch.xml'/>", 2, "include each other without end"),
        ("<group forwarding='false'/>", 2, "attribute 'forwarding'"),
        ("hello", 2, "unexpected text 'hello'"),
        ("<a></b>", 2, "not well-formed XML: mismatched tag"),
        (
            "<node pkg='demo' exec='talker'>\n<param from='/no.yaml'/></node>",
            3,
            "there is no parameter file /no.yaml",
        ),
        (
            "<node pkg='demo' exec='talker'>\n<param name='p' value='[1, a]'/></node>",
            3,
            "parameter 'p': '\\[1, a\\]' is not a list",
        ),
        (
            "<node pkg='demo' exec='talker'>\n<param name='p'/></node>",
            3,
            "needs the attribute 'value'",
        ),
        (
            "<node pkg='demo' exec='talker'>\n<param from='a' allow_substs='true'/></node>",
            3,
            "attribute 'allow_substs'",
        ),
    ],
)
def test_refuses_naming_file_and_line(world, body, line, reason):
    with pytest.raises(LaunchError, match=reason) as caught:
        load(world, body)
    assert caught.value.file == world.files / "test.launch.xml"
    assert caught.value.line == line
    assert str(caught.value).startswith(f"{world.files}/test.launch.xml:{line}: ")


def test_refuses_other_files(tmp_path):
    with pytest.raises(LaunchError, match="can't read the launch file: No such file"):
        launching.load(tmp_path / "none.launch.xml", {})
    other = tmp_path / "other.xml"
    other.write_text("<robot/>")
    with pytest.raises(LaunchError, match="starts with <launch>, not <robot>"):
        launching.load(other, {})
    other.write_text("<launch/>")
    with pytest.raises(LaunchError, match="nothing to start"):
        launching.load(other, {})
    other.write_text('<!DOCTYPE x [<!ENTITY a "b">]><launch/>')
    with pytest.raises(LaunchError, match="DOCTYPE"):
        launching.load(other, {})


def test_an_executable_of_another_python_loses_the_bootstrap_mark(world, monkeypatch):
    monkeypatch.setenv("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "1")
    (process,) = load(world, '<node pkg="demo" exec="talker"/>').processes
    assert "_ROS_WHEELS_BOOTSTRAP_COMPLETE" not in process.env
