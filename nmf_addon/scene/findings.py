"""What a check has found of a capture, kept with it."""

import json

import bpy
import numpy as np

FINDINGS = "nmf_findings"
_reports_on_linked: dict[int, dict] = {}
"""what checks found of captures that are linked from other files, by their `session_uid`"""


def keep_report(collection: bpy.types.Collection, report: dict) -> None:
    """Let a capture know what a check has found; one of another file knows it until Blender quits."""
    if collection.library:
        _reports_on_linked[collection.session_uid] = report
    else:
        collection[FINDINGS] = json.dumps(report)


def check_report(collection: bpy.types.Collection) -> dict:
    """What the last check of the capture found (`solver check`); {} if there was none."""
    if collection.session_uid in _reports_on_linked:
        return _reports_on_linked[collection.session_uid]
    try:
        return json.loads(collection.get(FINDINGS, "{}"))
    except ValueError:
        return {}


def masked_box(report: dict) -> np.ndarray | None:
    """Where masks show the object, in capture space [2, 3], as a check found it."""
    box = report.get("box")
    return None if box is None else np.array([box["min"], box["max"]], dtype=np.float64)
