"""The table of all commands: where each is, and what it does, by the way of work."""

from __future__ import annotations

from butterfly.cli.lazy import Command

PANELS: dict[str, dict[str, Command]] = {
    "Look at logs": {
        "inspect": Command(
            "log_commands",
            "inspect_command",
            "Check logs: clock, gaps, saturation, clipping, turns, and the dominant frequency.",
        ),
        "manifest": Command(
            "log_commands",
            "manifest_command",
            "Draft a data-set manifest of the logs in a folder, to edit and keep.",
        ),
    },
    "Identify": {
        "identify": Command(
            "identify_commands",
            "identify_command",
            "Identify the robot from a data set.",
        ),
        "select": Command(
            "judge_commands",
            "select_command",
            "Choose friction terms by how well they predict what was left out: added masses, or "
            "logs.",
        ),
    },
    "Judge": {
        "validate": Command(
            "judge_commands",
            "validate_command",
            "Predict logs that the estimator has not seen, and compare with those it has.",
        ),
        "predict": Command(
            "predict_commands",
            "predict_command",
            "Predict logs, or an experiment that nobody has done, with given parameters.",
        ),
        "residual": Command(
            "judge_commands",
            "residual_command",
            "Show what the identified model, all its terms, leaves over of the logs.",
        ),
        "compare": Command(
            "compare_commands",
            "compare_command",
            "Compare MuJoCo, grey-box model and logs for the same input.",
        ),
        "leaderboard": Command(
            "compare_commands",
            "leaderboard_command",
            "Rank estimators by how well they predict what they have not seen.",
        ),
    },
    "Plan": {
        "design": Command(
            "design_commands",
            "design_command",
            "Rank candidate next experiments by how much they would tell.",
        ),
    },
    "Simulate": {
        "run": Command(
            "run_commands",
            "run_command",
            "Simulate an experiment, identify the robot from its logs, and write a report.",
        ),
        "simulate": Command(
            "run_commands",
            "simulate_command",
            "Simulate an experiment in MuJoCo and write its logs.",
        ),
        "view": Command(
            "view_commands",
            "view_command",
            "Watch a run in MuJoCo's viewer, in real time; `--web` needs no display.",
        ),
        "video": Command(
            "view_commands",
            "video_command",
            "Draw a run as a film; needs no display where EGL is installed.",
        ),
        "schema": Command(
            "run_commands",
            "schema_command",
            "Print the JSON Schema of experiment or manifest files, for editors.",
        ),
    },
    "Hold an orbit": {
        "calibrate-orbit": Command(
            "orbit_commands",
            "calibrate_orbit_command",
            "Hold a large orbit, re-calibrate the model next to it, and hold it better.",
        ),
    },
    "Results": {
        "reproduce": Command(
            "thesis_commands",
            "reproduce_command",
            "Print the thesis's figures beside those obtained the same way, and the right ones.",
        ),
    },
}
"""The commands at the top, by the headings under which help lists them."""

COMMANDS = {
    name: command._replace(panel=panel)
    for panel, commands in PANELS.items()
    for name, command in commands.items()
}

LOGS_COMMANDS = {
    "fetch": Command(
        "fetch_commands",
        "fetch_command",
        "Fetch the thesis's 41 public logs, 40 MB, and check each by its SHA-256.",
    ),
}

MODEL_COMMANDS = {
    "show": Command(
        "model_commands", "show_command", "Print the robot's physical and lumped parameters."
    ),
    "render": Command(
        "model_commands",
        "render_command",
        "Draw the robot; needs no display where EGL is installed.",
    ),
    "export": Command(
        "model_commands",
        "export_command",
        "Write the robot as one MJCF file that loads in plain MuJoCo and in its viewer.",
    ),
}

RESULTS_COMMANDS = {
    "list": Command(
        "results_commands",
        "list_command",
        "List the sweeps whose results lie in a folder, and how many of their runs are done.",
    ),
    "show": Command(
        "results_commands",
        "show_command",
        "Show one run: what it set, what it found, how long it took, and with which versions.",
    ),
    "table": Command("results_commands", "table_command", "Print rows of a table."),
    "export": Command(
        "results_commands", "export_command", "Write rows of a table to a CSV or Parquet file."
    ),
    "compare": Command(
        "results_commands",
        "compare_command",
        "Tell whether a robot has changed between two identifications, or compare two runs.",
    ),
    "clean": Command(
        "results_commands",
        "clean_command",
        "Remove records that the sweep no longer has, and files that were never finished.",
    ),
}
