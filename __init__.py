"""Neural Microfacet Fields: an extension for Blender. All of it is in `nmf_addon`.

Blender is imported only on registration, so that tools without it can import this package.
"""


def register() -> None:
    """Called by Blender when the extension is enabled."""
    from .nmf_addon import registration

    registration.register()


def unregister() -> None:
    """Called by Blender when the extension is disabled."""
    from .nmf_addon import registration

    registration.unregister()
