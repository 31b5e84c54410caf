"""Settings of the asset."""

from dataclasses import dataclass


@dataclass(frozen=True)
class AssetSettings:
    """Mesh and textures."""

    cells: int = 300
    """cells per axis of the marching cubes grid, at most: the field's voxels, each cut into as many as that
    allows"""
    smoothing: int = 5
    """rounds that take the ripples of those cells away; 0: none"""
    triangles: int = 40_000
    """triangles after decimation"""
    texture_size: int = 1024
    """texels per edge of each texture"""
    photo_detail: bool = True
    """the albedo gets from the photos what is finer than the field's voxels, where their pixels are"""
    floater_share: float = 0.01
    """connected parts with less than this share of the largest part's area are dropped, unless photos show
    most of them and they are more than dust"""
    shred_share: float = 0.05
    """the same where photos have no masks, whatever they show: small parts are more likely shreds of what
    is around"""
    unseen_share: float = 0.02
    """there, a patch that no photo shows is cut off if its area is more than this share of what they show:
    nothing is known of it; smaller ones are holes to close"""
    march_voxels: float = 3.0
    """length of the walk along the normal through which a texel gathers materials, voxels"""
    march_samples: int = 7
    """samples of that walk"""
