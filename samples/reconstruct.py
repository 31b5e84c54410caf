"""Photos and cameras to a .blend with a relightable object, without a window.

    blender -b --python samples/reconstruct.py -- CAPTURE OUT.blend [--preset draft] …
    python samples/reconstruct.py -- CAPTURE OUT.blend …          (with the bpy wheel)

The same as `blender -c nmf reconstruct CAPTURE OUT.blend`; see `nmf_addon/headless.py`.
"""

import importlib
import importlib.util
import os
import sys
import traceback
from pathlib import Path


def load_extension():
    """The extension's package: the installed one if it is enabled, else this checkout."""
    for name in sys.modules:
        if name.startswith("bl_ext.") and name.endswith(".neural_microfacet_fields"):
            return sys.modules[name]
    root = Path(__file__).resolve().parent.parent
    spec = importlib.util.spec_from_file_location(
        "neural_microfacet_fields", root / "__init__.py", submodule_search_locations=[str(root)]
    )
    package = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = package
    spec.loader.exec_module(package)
    package.register()
    return package


def main() -> int:
    """Run `nmf reconstruct` with the arguments after `--`."""
    import bpy  # noqa: F401  (must come before the extension)

    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    package = load_extension()
    headless = importlib.import_module(f"{package.__name__}.nmf_addon.headless")
    return headless.main(["reconstruct", *arguments])


if __name__ == "__main__":
    try:
        code = main()
    except SystemExit as end:  # of argparse
        code = end.code
    except Exception:
        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender ends itself after its script; the bpy wheel can crash while Python shuts down.
    os._exit(code)
