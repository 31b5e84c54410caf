"""What `--help` and the manual say of the command line."""

import argparse
import re

import pytest

from solver import cli
from tests.cli.command import MANUAL, check_help, commands_of

COMMANDS = commands_of(cli._parser())


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_option_and_argument_says_what_it_is_for(name):
    check_help(COMMANDS[name])
    assert len(COMMANDS[name].description) > 10


def test_every_command_is_listed_with_what_it_does():
    (listed,) = [a for a in cli._parser()._actions if isinstance(a, argparse._SubParsersAction)]
    assert {shown.dest for shown in listed._choices_actions if shown.help} == set(COMMANDS)


def test_the_manual_names_commands_and_options_that_are_there():
    lines = re.findall(r"python -m solver (\w+)([^\n`]*)", MANUAL)
    assert {name for name, _ in lines} == set(COMMANDS) - {"run"}
    for name, rest in lines:
        known = {option for action in COMMANDS[name]._actions for option in action.option_strings}
        assert set(re.findall(r"--[\w-]+", rest)) <= known, name
