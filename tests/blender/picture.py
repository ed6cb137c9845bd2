"""A picture of a glTF or OBJ file by Blender, without a window:

    blender --background --factory-startup --python picture.py -- scene.json

scene.json: "model" (.glb or .obj), "out" (PNG); "size" (pixels a side), "fov" (degrees), "camera" (its place; it looks
along -z, y up, in glTF's axes); "fps" and "frame" of the first animation; "pose": bones turned about
their heads from there, {"name": [x, y, z]}, axis times angle in glTF's axes. An OBJ has neither.
"""

import json
import math
import sys

import bpy
import numpy
from mathutils import Matrix, Vector

# Blender 3.4's importer asks NumPy for a name that NumPy 1.24 has no more.
if not hasattr(numpy, "bool"):
    numpy.bool = bool

with open(sys.argv[sys.argv.index("--") + 1]) as file:
    asked = json.load(file)


def to_blender(v):
    """From glTF's axes (y up) to Blender's (z up)."""
    return Vector((v[0], -v[2], v[1]))


scene = bpy.context.scene
for thing in list(bpy.data.objects):
    bpy.data.objects.remove(thing)
scene.render.fps = asked["fps"]
armature = None
if asked["model"].endswith(".obj"):
    bpy.ops.wm.obj_import(filepath=asked["model"])
    # What the material's texture is, without a lamp on it.
    for material in (slot.material for o in bpy.data.objects for slot in o.material_slots):
        nodes, links = material.node_tree.nodes, material.node_tree.links
        shader = next(n for n in nodes if n.type == "BSDF_PRINCIPLED")
        colour = shader.inputs["Base Color"].links[0].from_socket
        light = nodes.new("ShaderNodeEmission")
        links.new(colour, light.inputs["Color"])
        output = next(n for n in nodes if n.type == "OUTPUT_MATERIAL")
        links.new(light.outputs["Emission"], output.inputs["Surface"])
else:
    bpy.ops.import_scene.gltf(filepath=asked["model"])
    armature = next(o for o in bpy.data.objects if o.type == "ARMATURE")
if armature and bpy.data.actions:
    action = armature.animation_data.action or bpy.data.actions[0]
    armature.animation_data.action = action
    scene.frame_set(round(action.frame_range[0]) + asked["frame"])
for name, turn in asked["pose"].items():
    # A key would win over what is set by hand.
    armature.animation_data_clear()
    bone = armature.pose.bones[name]
    axis = to_blender(turn)
    head = Matrix.Translation(bone.head)
    bone.matrix = head @ Matrix.Rotation(axis.length, 4, axis) @ head.inverted() @ bone.matrix
    bpy.context.view_layer.update()

camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
scene.collection.objects.link(camera)
camera.location = to_blender(asked["camera"])
camera.rotation_euler = (math.pi / 2, 0, 0)
camera.data.angle = math.radians(asked["fov"])
camera.data.clip_start = 0.01
scene.camera = camera

scene.render.engine = "CYCLES"
scene.cycles.device = "CPU"
scene.cycles.samples = 32
scene.cycles.use_denoising = False
scene.cycles.pixel_filter_type = "BOX"
scene.cycles.filter_width = 1
scene.render.film_transparent = True
scene.render.resolution_x = scene.render.resolution_y = asked["size"]
scene.render.resolution_percentage = 100
scene.view_settings.view_transform = "Standard"
scene.render.image_settings.file_format = "PNG"
scene.render.image_settings.color_mode = "RGBA"
scene.render.filepath = asked["out"]
bpy.ops.render.render(write_still=True)
