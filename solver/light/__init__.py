"""The unknown light: an HDR environment map, its filtered lookups and its irradiance."""
