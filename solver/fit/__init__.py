"""The optimisation: from photos to a microfacet field and its light."""
