"""What a reconstruction is in Blender's terms: cameras, box, object, material, World."""
