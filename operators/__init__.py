"""One file per thing a person can do. Thin: each calls plain functions of `nmf_addon`."""
