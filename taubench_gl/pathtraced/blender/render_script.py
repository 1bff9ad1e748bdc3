"""Runs in Blender's Python: renders the frames of one job with Cycles.  Imports only bpy, the standard
library and ``script_shared.py`` beside it.

    python render_script.py job.json

Reports events as lines that start with ``@tb `` and hold one JSON object.  All other output is Blender's.
"""

import math
import os
import time

import bpy
from mathutils import Matrix, Vector
from script_shared import fcurves_of, read_job, report, stop

BLENDER_FROM_GLTF = Matrix(((1, 0, 0), (0, 0, -1), (0, 1, 0)))
PASSES = (
    "z", "position", "normal", "vector", "emit", "environment",
    *(f"{lobe}_{part}" for lobe in ("diffuse", "glossy", "transmission") for part in ("direct", "indirect", "color")),
)  # fmt: skip
CRISP_FILTER_PX = 0.01  # smallest filter width of Cycles, for Blackman-Harris; its BOX filter is always 1 pixel wide
NODE_NAME = "taubench node {}"  # of mesh nodes, by index, as in job.py
INFINITE_ZFAR = 1e6  # meters, for cameras without a far plane
SAMPLES_EVERY = 1.0  # seconds between reports of finished samples


def main():
    job = read_job()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 24, 1.0  # frame rate of the written keys: job frames are Blender frames
    bpy.ops.import_scene.gltf(filepath=job["scene"], import_shading="NORMALS")
    activate_animations(job["first_key"])
    place_camera(scene, job)
    place_lights(scene, job)
    light_sky(scene, job["sky"], job["image"])
    if job["cull_back_faces"]:
        hide_back_faces()
    if job["single_scatter"]:
        scatter_once()
    configure(scene, job)
    report(event="ready", blender=bpy.app.version_string, objects=len(scene.objects), actions=len(bpy.data.actions))
    watch_samples(job["samples"])
    for folder, seed in zip(job["folders"], job["seeds"]):
        scene.cycles.seed = seed
        for frame in job["frames"]:
            started, cpu_started = time.perf_counter(), time.process_time()
            render(scene, job, frame, folder)
            cpu = time.process_time() - cpu_started
            report(event="frame", frame=frame, seconds=time.perf_counter() - started, cpu_seconds=cpu)
    report(event="done")
    stop(0)


def activate_animations(first_key):
    """Activate every object's action, mute the strips, and move the keys to the job's whole frame numbers.

    The importer puts actions into strips on muted tracks, from frame 1, and rounds key times to float32 seconds.
    """
    owners = [*bpy.data.objects, *bpy.data.shape_keys, *bpy.data.materials, *bpy.data.node_groups]
    owners += [material.node_tree for material in bpy.data.materials if material.node_tree]
    for owner in owners:
        animation = owner.animation_data
        if animation is None:
            continue
        for track in animation.nla_tracks:
            track.mute = True
            if animation.action is None and track.strips:
                strip = track.strips[0]
                animation.action = strip.action
                if hasattr(strip, "action_slot"):
                    animation.action_slot = strip.action_slot
    for action in bpy.data.actions:
        for curve in fcurves_of(action):
            for key in curve.keyframe_points:
                key.co.x = round(key.co.x) + first_key
                key.interpolation = "LINEAR"
            curve.update()


def pose(owner, position, rotation, frame):
    """Place an object by its glTF world position and world_from_local rotation (3x3 rows); key it at ``frame``."""
    owner.rotation_mode = "QUATERNION"
    owner.location = BLENDER_FROM_GLTF @ Vector(position)
    owner.rotation_quaternion = (BLENDER_FROM_GLTF @ Matrix(rotation)).to_quaternion()
    if frame is not None:
        owner.keyframe_insert("location", frame=frame)
        owner.keyframe_insert("rotation_quaternion", frame=frame)


def place_camera(scene, job):
    data = bpy.data.cameras.new("taubench")
    camera = bpy.data.objects.new("taubench", data)
    scene.collection.objects.link(camera)
    scene.camera = camera
    data.sensor_fit = "VERTICAL"
    for frame, entry in job["camera"].items():
        frame = int(frame)
        matrix = entry["world_from_view"]
        pose(camera, [row[3] for row in matrix[:3]], [row[:3] for row in matrix[:3]], frame)
        data.clip_start = max(entry["znear"], 1e-6)
        data.clip_end = INFINITE_ZFAR if entry["zfar"] is None else entry["zfar"]
        if entry["kind"] == "orthographic":
            data.type, data.ortho_scale = "ORTHO", 2.0 * entry["ymag"]
            data.keyframe_insert("ortho_scale", frame=frame)
        else:
            data.lens = 0.5 * data.sensor_height / math.tan(0.5 * entry["yfov"])
            data.keyframe_insert("lens", frame=frame)
    linear_keys(camera, data)


def place_lights(scene, job):
    """Add the punctual lights of the job, in glTF units.  Cycles divides watts by 4 pi, so a point light of I candela
    gets 4 pi I watts.
    """
    for index, light in enumerate(job["lights"]):
        kind = {"point": "POINT", "spot": "SPOT", "directional": "SUN"}[light["kind"]]
        data = bpy.data.lights.new(f"taubench {index}", kind)
        owner = bpy.data.objects.new(f"taubench {index}", data)
        scene.collection.objects.link(owner)
        data.color = (1.0, 1.0, 1.0)
        if kind == "SUN":
            data.angle = 0.0
        else:
            data.shadow_soft_size = 0.0
        if light["constant"]:  # strength x distance^2 cancels the attenuation
            data.use_nodes = True
            nodes, links = data.node_tree.nodes, data.node_tree.links
            falloff = nodes.new("ShaderNodeLightFalloff")
            falloff.inputs["Strength"].default_value = 1.0
            links.new(falloff.outputs["Constant"], nodes["Emission"].inputs["Strength"])
        moves = len(light["frames"]) > 1
        for frame, entry in light["frames"].items():
            frame = int(frame) if moves else None
            pose(owner, entry["position"], entry["rotation"], frame)
            data.color = entry["color"]
            data.energy = entry["intensity"] * (1.0 if kind == "SUN" else 4.0 * math.pi)
            if kind == "SPOT":
                data.spot_size = 2.0 * entry["outer_cone"]
                data.spot_blend = 1.0 - entry["inner_cone"] / entry["outer_cone"]
            if moves:
                for path in ("color", "energy"):
                    data.keyframe_insert(path, frame=frame)
        linear_keys(owner, data)


def linear_keys(*owners):
    for owner in owners:
        if owner.animation_data and owner.animation_data.action:
            for curve in fcurves_of(owner.animation_data.action):
                for key in curve.keyframe_points:
                    key.interpolation = "LINEAR"


def light_sky(scene, color, image):
    """Light the scene by a uniform radiance, or an equirectangular image: Blender's center of an image is +X too."""
    world = bpy.data.worlds.new("taubench")
    scene.world = world
    world.use_nodes = True
    background = world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (*color, 1.0)
    background.inputs["Strength"].default_value = 1.0
    if image is not None:
        texture = world.node_tree.nodes.new("ShaderNodeTexEnvironment")
        texture.image = bpy.data.images.load(image)
        world.node_tree.links.new(texture.outputs["Color"], background.inputs["Color"])


def hide_back_faces():
    """Hide back faces of single-sided materials from camera rays, as glTF requires; both sides cast shadows."""
    for material in bpy.data.materials:
        if not material.use_backface_culling or not material.use_nodes:
            continue
        nodes, links = material.node_tree.nodes, material.node_tree.links
        output = next((n for n in nodes if n.type == "OUTPUT_MATERIAL" and n.is_active_output), None)
        if output is None or not output.inputs["Surface"].links:
            continue
        surface = output.inputs["Surface"].links[0].from_socket
        geometry, path = nodes.new("ShaderNodeNewGeometry"), nodes.new("ShaderNodeLightPath")
        both, mix = nodes.new("ShaderNodeMath"), nodes.new("ShaderNodeMixShader")
        both.operation = "MULTIPLY"
        links.new(geometry.outputs["Backfacing"], both.inputs[0])
        links.new(path.outputs["Is Camera Ray"], both.inputs[1])
        links.new(both.outputs[0], mix.inputs[0])
        links.new(surface, mix.inputs[1])
        links.new(nodes.new("ShaderNodeBsdfTransparent").outputs[0], mix.inputs[2])
        links.new(mix.outputs[0], output.inputs["Surface"])


def scatter_once():
    """Make materials what glTF defines: GGX without multiple scattering, no offset of shadow rays on smooth meshes."""
    for material in bpy.data.materials:
        for node in material.node_tree.nodes if material.use_nodes else ():
            if node.type == "BSDF_PRINCIPLED":
                node.distribution = "GGX"
            elif node.type == "VOLUME_ABSORPTION":
                absorb_as_gltf(node)
    for owner in bpy.data.objects:
        if owner.type == "MESH":
            owner.cycles.shadow_terminator_geometry_offset = owner.cycles.shadow_terminator_offset = 0.0


def absorb_as_gltf(node):
    """Correct the absorption of a volume: the importer writes color and 1 / distance of KHR_materials_volume, of which
    Cycles takes (1 - color) / distance; the extension has -ln(color) / distance.
    """
    color, density = node.inputs["Color"], node.inputs["Density"]
    if color.is_linked or density.is_linked:
        return
    absorbed = [-math.log(max(c, 1e-9)) * density.default_value for c in color.default_value[:3]]
    most = max(absorbed)
    density.default_value = most
    color.default_value = (*(1.0 - a / most if most > 0.0 else 1.0 for a in absorbed), 1.0)


def configure(scene, job):
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = job["samples"]
    # With one seed for all frames, the noise would be the same in every frame and reuse could not average it.
    cycles.use_animated_seed = job["seed_per_frame"]
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = job["bounces"]
    cycles.transparent_max_bounces = 64
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0  # clamping would bias the reference
    cycles.light_sampling_threshold = 0.0  # no light is left out
    cycles.blur_glossy = 0.0
    cycles.caustics_reflective = cycles.caustics_refractive = True
    if job["crisp"]:
        cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", CRISP_FILTER_PX
    render = scene.render
    render.use_motion_blur = render.film_transparent = False
    render.resolution_x, render.resolution_y = job["size"]
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    if job["threads"]:
        render.threads_mode, render.threads = "FIXED", job["threads"]
    layer = scene.view_layers[0]
    for name in PASSES:
        setattr(layer, f"use_pass_{name}", True)
    settings = render.image_settings
    if hasattr(settings, "media_type"):  # Blender 5
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER"
    settings.color_depth, settings.exr_codec = "32", "ZIP"


def watch_samples(total):
    last = [0.0]

    def stats(text, *_):
        if "Sample" not in str(text) or time.perf_counter() - last[0] < SAMPLES_EVERY:
            return
        last[0] = time.perf_counter()
        samples_done = str(text).rsplit("Sample", 1)[1].strip().split("/")[0]
        if samples_done.isdigit():
            report(event="samples", done=int(samples_done), total=total)

    bpy.app.handlers.render_stats.append(stats)


def hide(nodes):
    """Hide the meshes of ``nodes``, with the instances that the importer made children of them; show all others."""
    for owner in bpy.data.objects:
        if owner.type != "MESH":
            continue
        at = owner
        while at is not None and not at.name.startswith(NODE_NAME.format("")):
            at = at.parent
        if at is not None:
            number = at.name.removeprefix(NODE_NAME.format("")).split(".")[0]
            owner.hide_render = number.isdecimal() and int(number) in nodes


def render(scene, job, frame, folder):
    """Render ``frame`` to a name that is no frame name, then rename the file: readers never see an incomplete frame."""
    target = os.path.join(folder, job["name"] % frame)
    partial = os.path.join(folder, "." + os.path.basename(target) + ".partial.exr")
    scene.frame_set(frame)
    hide(set(job["hidden"].get(str(frame), ())))
    scene.render.filepath = partial
    bpy.ops.render.render(write_still=True)
    with open(partial, "rb+") as file:
        os.fsync(file.fileno())
    os.replace(partial, target)


if __name__ == "__main__":
    main()
