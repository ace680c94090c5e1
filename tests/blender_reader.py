"""Blender (the package bpy) reads a scene of ours: prints what its cameras see of points, or its meshes' points."""

import json
import sys

import bpy  # pyright: ignore[reportMissingImports]
from bpy_extras.object_utils import world_to_camera_view  # pyright: ignore[reportMissingImports]
from mathutils import Vector  # pyright: ignore[reportMissingImports]

kind, path, given = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
if kind == "blender":
    with open(path) as file:
        exec(compile(file.read(), path, "exec"), {"__name__": "__main__"})
elif kind == "gltf":
    bpy.ops.import_scene.gltf(filepath=path)
else:
    bpy.ops.wm.ply_import(filepath=path)
bpy.context.view_layer.update()
scene = bpy.context.scene
wanted = json.loads(given)
seen = {}
for thing in bpy.data.objects:
    if thing.type == "CAMERA":
        one = wanted[thing.name]
        scene.render.resolution_x, scene.render.resolution_y = one["size"]
        seen[thing.name] = list(world_to_camera_view(scene, thing, Vector(one["point"])))
    elif thing.type == "MESH":
        seen[thing.name] = [list(thing.matrix_world @ vertex.co) for vertex in thing.data.vertices]
print("found " + json.dumps(seen))
