"""Build the solver's private Python environment, and see what it can do."""

from __future__ import annotations

import subprocess

import bpy

from ..nmf_addon import preferences, runtime, setup_monitor


class NMF_OT_setup_solver(bpy.types.Operator):
    """Download the solver's packages (1 to 4 GB, once per computer) into a private folder"""

    bl_idname = "nmf.setup_solver"
    bl_label = "Set Up Solver"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """While none runs."""
        cls.poll_message_set("The set-up is running")
        return not setup_monitor.setup_state().running

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Start the set-up."""
        wheelhouse = preferences.chosen("wheelhouse")
        if not wheelhouse and not bpy.app.online_access:
            why = " (it was switched off at start-up)" if bpy.app.online_access_override else ""
            self.report(
                {"ERROR"},
                f"Online access is off{why}: allow it in Preferences › System › Network, or choose "
                "a wheelhouse in the extension's preferences",
            )
            return {"CANCELLED"}
        folder = runtime.managed_runtime(preferences.chosen_runtime())
        try:
            python = setup_monitor.base_python(preferences.chosen("base_python"))
            arguments = preferences.chosen("pip_arguments")
            setup_monitor.start_setup(folder, python, wheelhouse, arguments)
        except (runtime.RuntimeMissing, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class NMF_OT_cancel_setup(bpy.types.Operator):
    """Stop the set-up; an older solver stays as it was"""

    bl_idname = "nmf.cancel_setup"
    bl_label = "Cancel Set-Up"
    bl_options = {"INTERNAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Stop it."""
        setup_monitor.cancel_setup()
        return {"FINISHED"}


class NMF_OT_copy_setup_log(bpy.types.Operator):
    """Copy all that the set-up printed, to paste into a question"""

    bl_idname = "nmf.copy_setup_log"
    bl_label = "Copy Log"
    bl_options = {"INTERNAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Copy to the clipboard."""
        context.window_manager.clipboard = "\n".join(setup_monitor.setup_state().log)
        self.report({"INFO"}, "The log is in the clipboard")
        return {"FINISHED"}


class NMF_OT_check_solver(bpy.types.Operator):
    """Start the solver once and copy its versions, devices and memory to the clipboard"""

    bl_idname = "nmf.check_solver"
    bl_label = "Check Solver"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Run the solver's own `doctor`."""
        try:
            python = preferences.solver_python()
            answer = subprocess.run(
                [str(python), "-I", "-X", "utf8", str(runtime.bootstrap_script()), "doctor"],
                capture_output=True, encoding="utf-8", errors="replace", timeout=120, check=False,
                env=runtime.clean_environment(), stdin=subprocess.DEVNULL,
            )  # fmt: skip
        except (runtime.RuntimeMissing, OSError, subprocess.TimeoutExpired) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if answer.returncode != 0:
            last = (answer.stderr.strip().splitlines() or ["no message"])[-1]
            self.report({"ERROR"}, f"The solver does not start: {last}; set it up again")
            return {"CANCELLED"}
        context.window_manager.clipboard = answer.stdout
        for line in answer.stdout.splitlines():
            self.report({"INFO"}, line)
        return {"FINISHED"}


classes = (
    NMF_OT_setup_solver, NMF_OT_cancel_setup, NMF_OT_copy_setup_log, NMF_OT_check_solver,
)  # fmt: skip
