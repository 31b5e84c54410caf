"""Each metric once. Images are sRGB in [0, 1] over white unless a function says otherwise."""
