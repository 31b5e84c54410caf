"""What the exit code of a command says, to a shell, a farm and Blender alike."""

DONE, FAILED, BAD_INPUT, CANCELLED, OUT_OF_MEMORY = 0, 1, 2, 3, 4
