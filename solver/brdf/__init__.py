"""How the surface scatters: Schlick's Fresnel, GGX with visible-normal sampling, the neural term."""
