"""Build the solver's private Python environment, and see what it can do."""

import bpy
from bpy.types import Context, Operator

from ..nmf_addon import preferences, runtime, setup_monitor
from ..nmf_addon.jobs.monitor import monitor
from ..nmf_addon.jobs.side_task import side_task
from .polls import reporting


class NMF_OT_setup_solver(Operator):
    """Download the solver's packages (1 to 4 GB, once per computer) into a private folder"""

    bl_idname = "nmf.setup_solver"
    bl_label = "Set Up Solver"

    @classmethod
    def poll(cls, context: Context) -> bool:
        """While neither a set-up nor a check runs, nor the solver, which would lose its packages."""
        if monitor.running or side_task.running:
            cls.poll_message_set("The solver is running; cancel it, or wait for it")
            return False
        return _may_start(cls)

    @reporting()
    def execute(self, context: Context) -> set[str] | None:
        wheelhouse = preferences.chosen("wheelhouse")
        if not wheelhouse and not bpy.app.online_access:
            why = " (it was switched off at start-up)" if bpy.app.online_access_override else ""
            raise runtime.RuntimeMissing(
                f"Online access is off{why}: allow it in Preferences › System › Network, or choose "
                "a wheelhouse in the extension's preferences"
            )
        folder = runtime.managed_runtime(preferences.chosen("runtime_folder"))
        python = setup_monitor.base_python(preferences.chosen("base_python"))
        arguments = preferences.chosen("pip_arguments")
        setup_monitor.start_setup(folder, python, wheelhouse, arguments)


class NMF_OT_cancel_setup(Operator):
    """Stop; a solver that was set up before stays as it was"""

    bl_idname = "nmf.cancel_setup"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    def execute(self, context: Context) -> set[str]:
        setup_monitor.cancel_setup()
        return {"FINISHED"}


class NMF_OT_copy_setup_log(Operator):
    """Copy the output of the set-up or the check, to paste into a bug report"""

    bl_idname = "nmf.copy_setup_log"
    bl_label = "Copy Log"
    bl_options = {"INTERNAL"}

    def execute(self, context: Context) -> set[str]:
        context.window_manager.clipboard = "\n".join(setup_monitor.setup_state().log)
        self.report({"INFO"}, "Copied the log to the clipboard")
        return {"FINISHED"}


class NMF_OT_check_solver(Operator):
    """Start the solver once to see its versions, devices and memory"""

    bl_idname = "nmf.check_solver"
    bl_label = "Check Solver"

    @classmethod
    def poll(cls, context: Context) -> bool:
        return _may_start(cls)

    @reporting()
    def execute(self, context: Context) -> set[str] | None:
        setup_monitor.start_check(preferences.solver_python())


def _may_start(operator: type[Operator]) -> bool:
    state = setup_monitor.setup_state()
    operator.poll_message_set(f"The {'check' if state.is_check else 'set-up'} is running")
    return not state.running


classes = (NMF_OT_setup_solver, NMF_OT_cancel_setup, NMF_OT_copy_setup_log, NMF_OT_check_solver)
