"""Neural microfacet fields: photos of a shiny object to mesh, PBR textures and HDRI."""

__version__ = "0.1.0"
