"""What several tests need."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

WORKSPACE = Path(__file__).parents[2]


@pytest.fixture(scope="session")
def command_line() -> Callable[..., Any]:
    """Runs a sub-command of host-sim and reads the JSON object that it prints."""
    metadata = subprocess.run(
        ["cargo", "metadata", "--format-version=1", "--no-deps"],
        cwd=WORKSPACE,
        check=True,
        capture_output=True,
    )
    program = Path(json.loads(metadata.stdout)["target_directory"]) / "release" / "host-sim"

    def run(*arguments: object) -> Any:
        command = [program, *map(str, arguments), "--json"]
        done = subprocess.run(command, cwd=WORKSPACE, check=True, capture_output=True)
        return json.loads(done.stdout)

    return run
