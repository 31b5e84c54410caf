"""Camera files, a reader each; `capture.read` chooses among them.

A reader is a module with

    NAME        what a person calls the format
    PATTERNS    where its camera file usually lies in a capture's folder (globs, likeliest first);
                their extensions, in lower case, are in file dialogs
    recognises(file) -> bool          by content, also if it is cut off; never raises
    read(file, photos) -> Capture     raises CaptureError for anything that cannot be used; `photos`
                                      finds what the file names

It states what the file says as `Found` cameras and leaves to `intake.assemble` what all share:
missing photos, sizes, names, the region. Poses leave it as OpenGL camera-to-world.
"""
