"""Texts of commands, by their names.

Made by `make commands`: what is changed here is overwritten.
"""

SUMMARIES = {
    "inspect": "Check logs for faults, and forecast how well they determine the parameters.",
    "manifest": "Write a draft manifest for the logs in a folder, or in one file.",
    "fetch": "Download the 41 public logs of the thesis (40 MB).",
    "identify": "Identify the joint from logs.",
    "select": "Choose terms as identify does, and show how well each choice predicts.",
    "design": "Say which run to do next: the one that reaches a goal in the least robot time.",
    "validate": "Cross-validate an estimator on held-out logs, or rank several.",
    "residual": "Analyse the residuals, and name the terms that the model is missing.",
    "predict": "Predict logs, or a new experiment, with known parameters.",
    "compare": "Compare two saved results; or MuJoCo, the model and the logs.",
    "export": (
        "Export the identified joint (its twin) to MuJoCo, URDF, C and others, or into "
        "your own model."
    ),
    "show": "Watch a run, or save it as a film or picture.",
    "run": "Simulate an experiment or a sweep, identify the joint, and write a report.",
    "simulate": "Simulate an experiment and write its logs.",
    "campaign": (
        "Run experiments on an unknown joint, each chosen from those before, until a goal "
        "is reached."
    ),
    "schema": "Print the JSON Schema of experiment or manifest files.",
    "reproduce": "Reproduce the thesis's numbers, with its mistakes and without.",
    "report": (
        "Collect what to attach to a report of an error: versions, health of logs, a result."
    ),
    "library list": "List the motors of the library.",
    "library show": "Show a motor: what it takes to another joint, and where that is from.",
    "library draft": (
        "Write a file for the library from a saved result: your motor's values, the rest "
        "to fill in."
    ),
    "results clean": "Remove outdated records and unfinished files.",
}
"""First lines of commands."""

DESCRIPTIONS = {
    "inspect": (
        "Check logs for faults, and forecast how well they determine the parameters.\n\n"
        "Checks clock, gaps, saturation and clipping. Several logs are listed worst "
        "first; --verbose adds those without findings. Of an experiment or a saved "
        "identification: the robot's parameters instead. Of a folder of results: what is "
        "in it, verdict first; of a run or sweep: its answer."
    ),
    "identify": (
        "Identify the joint from logs.\n\nThe result has a verdict, and the parameters with "
        "95 % intervals."
    ),
    "select": (
        "Choose terms as identify does, and show how well each choice predicts.\n\nEach "
        "round adds the term that improves the prediction of held-out logs most, or "
        "removes one that does not help. Every set of terms has its FIT in sample and on "
        "held-out added masses, or logs. The verdict is on the model with the chosen "
        "terms."
    ),
    "design": (
        "Say which run to do next: the one that reaches a goal in the least robot time.\n\n"
        "Candidates: sines, multisines and free decays, with each added mass and without. "
        "Each one is simulated with the identified parameters."
    ),
    "validate": (
        "Cross-validate an estimator on held-out logs, or rank several.\n\nWith several "
        "methods or data sets, ranks the methods by their median FIT on held-out logs."
    ),
    "residual": (
        "Analyse the residuals, and name the terms that the model is missing.\n\nCompares "
        "each log's free-run error with the sensor noise, and tests its correlations."
    ),
    "predict": (
        "Predict logs, or a new experiment, with known parameters.\n\nSimulates each log "
        "from its initial angle with the recorded input alone. The verdict says whether "
        "the parameters reproduce the logs. With bands there are two 95 % bands: one for "
        "the uncertainty of the parameters, one for a new log (with the model error)."
    ),
    "simulate": (
        "Simulate an experiment and write its logs.\n\nThe format is that of real logs, "
        "which identify reads."
    ),
    "campaign": (
        "Run experiments on an unknown joint, each chosen from those before, until a goal "
        "is reached.\n\nFinds which way the drive turns, plays a safe probe, and after each "
        "run identifies the joint and chooses the next run: the one that reaches the goal "
        "in the least robot time. The folder then has a log of each run, their manifest "
        "and a report. Called again, it continues where it stopped."
    ),
}
"""What verbs say before their parameters."""

ARGUMENTS = {
    "inspect.source": (
        "Logs, a folder of logs, a manifest, an experiment, or a shipped name; a saved "
        "result, a folder of results, or a run of a sweep: results/NAME/NUMBER."
    ),
    "identify.data": (
        "Logs, a folder of logs, a manifest, a saved result, or a shipped data set's name."
    ),
    "identify.against": (
        "Parameters to compare with: p1=0.003,p2=0.001,p3=0.05. Without p4, the best-fitting one."
    ),
    "select.data": (
        "Logs, a folder of logs, a manifest, a saved result, or a shipped data set's name."
    ),
    "design.data": (
        "A saved result; or logs, a folder of logs, a manifest or a shipped data set's "
        "name, to identify first."
    ),
    "validate.data": (
        "A data set (logs, a folder of logs, a manifest, a saved result, or a shipped "
        "name), or several to rank methods on."
    ),
    "residual.data": (
        "A saved result; or logs, a folder of logs, a manifest or a shipped data set's "
        "name, to identify first."
    ),
    "predict.data": (
        "Logs, a folder of logs, a manifest, a saved result, an experiment (to simulate "
        "its inputs), or a shipped name."
    ),
    "predict.result": (
        "A saved result, or parameters: p1=0.18,p3=3.7,coulomb=0.01. Others are 0; "
        "without p4 the best-fitting one is used, without zero the logs' own encoder "
        "zero."
    ),
    "run.experiment": "An experiment file (YAML), or a shipped experiment's name.",
    "simulate.experiment": "An experiment file (YAML), or a shipped experiment's name.",
    "simulate.out": "Folder for the logs and their manifest.",
    "campaign.robot": (
        "An experiment, whose robot is simulated; or MODULE:FACTORY, a function that "
        "returns a motor."
    ),
}
"""What verbs say of parameters that their commands declare."""

FACTS = {
    "file": "Path below the data set's root",
    "at": ("Place within a file of several logs: keys with dots (JSON, MATLAB), a sheet, an array"),
    "columns": "Columns (or variables) of time, input and angle, by name or number",
    "units": "Units of the columns, mass, arm and omega, or factors",
    "interval": "Sampling interval in s of logs without a column of time",
    "added_mass": "In kg, with or without an uncertainty",
    "arm": "Distance from pivot to added mass in m",
    "inertia": (
        "Of the added mass about its own centre, in kg m^2; m r^2/2 for a disc of radius r"
    ),
    "omega": "Of a commanded sine, in rad/s",
    "amplitude": "Of that sine, in units of the input; set both or neither",
    "input": "Kind of input",
    "zero": "Encoder zero: the reading in rad where the joint hangs at rest",
    "loop": "Control loop of a servo: its law and gains",
    "begin": "Start in s of the piece to use, on the clock of the file",
    "end": "End in s of the piece to use",
    "of": "Name of the joint in that model",
    "pose": "Positions of the model's other joints in rad or m",
    "neighbours": "Columns of the positions of other joints of the model, by joint",
    "part": (
        "Number of the recording in the file, from 1; a recording ends where the clock falls back"
    ),
    "split": "Split a file where its clock restarts",
    "root": ("Folder of the files, relative to the manifest; ${NAME} is an environment variable"),
    "intersample": (
        "Input between its samples: zero_order_hold (held until the next) or "
        "first_order_hold (straight lines)"
    ),
    "sign": (
        "-1 if a positive command turns the joint towards negative angles: the input is negated"
    ),
    "joint": "hinge or slide, whose angle is in m and p1 in kg",
    "shape": ("Shape in pictures and exported models: a plain bar, or the Butterfly robot's hand"),
    "gravity": "Gravity in m/s^2, perpendicular to the axis; 0 for a vertical axis",
    "model": "MJCF or URDF of the robot whose joint the logs move",
    "clamped": "Whether that model's joints without columns are clamped",
    "link_masses": "Uncertainty of that model's masses: 5 % (0.05), one factor for all",
    "facts": "What the model says of the joint; read from it",
    "encoder": (
        "motor if angle, velocity, setpoint and the loop's gains are on the motor side of "
        "a gear, whose gear_ratio must be known"
    ),
    "known": "Known values of the robot, with standard uncertainties",
    "zeros": "Encoder zero per added mass; overrides zero, and a log's own zero overrides both",
    "repair": "Faults to repair",
    "holdout": "Files, or glob patterns of them, held out from fits for testing",
    "logs": "The files",
}
"""First sentences on the fields of a manifest."""
