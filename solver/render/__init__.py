"""How a pixel is made: marching, shading with secondary rays, compositing, tone mapping."""
