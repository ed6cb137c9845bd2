"""The animation of a glTF file as FBX, by Blender: blender --background --factory-startup --python
to_fbx.py -- in.glb out.fbx frames-per-second"""

import sys

import bpy
import numpy

# Blender 3.4's importer asks NumPy for a name that NumPy 1.24 has no more.
if not hasattr(numpy, "bool"):
    numpy.bool = bool

glb, fbx, fps = sys.argv[sys.argv.index("--") + 1 :]
for thing in list(bpy.data.objects):
    bpy.data.objects.remove(thing)
scene = bpy.context.scene
scene.render.fps = int(fps)
bpy.ops.import_scene.gltf(filepath=glb)
scene.frame_start, scene.frame_end = (round(f) for f in bpy.data.actions[0].frame_range)
bpy.ops.export_scene.fbx(filepath=fbx, add_leaf_bones=False)
