// What three.js, and of a .vrm three-vrm, make of an export, as JSON:
//
//     node load.mjs FILE
//
// Without a file nothing but whether both are found: exits with 3 where they are not.

import fs from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";
import path from "node:path";

const [file] = process.argv.slice(2);

async function packages() {
    try {
        const require = createRequire(import.meta.url);
        const folder = path.dirname(path.dirname(require.resolve("three")));
        const load = (at) => import(pathToFileURL(at));
        const vrm = path.dirname(require.resolve("@pixiv/three-vrm"));
        return {
            THREE: await load(path.join(folder, "build/three.module.js")),
            ...(await load(path.join(folder, "examples/jsm/loaders/GLTFLoader.js"))),
            ...(await load(path.join(vrm, "three-vrm.module.js"))),
        };
    } catch {
        process.exit(3);
    }
}

const { THREE, GLTFLoader, VRMLoaderPlugin } = await packages();
if (!file) process.exit(0);

// Pictures need a browser; the mesh does not.
globalThis.self = globalThis;
THREE.ImageLoader.prototype.load = (url, done) => setTimeout(() => done({ width: 1, height: 1 }));

const loader = new GLTFLoader();
if (file.endsWith(".vrm")) loader.register((parser) => new VRMLoaderPlugin(parser));
const bytes = fs.readFileSync(file);
const gltf = await loader.parseAsync(
    bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length), "");

const told = { meshes: [], materials: [], animations: gltf.animations.length };
gltf.scene.updateMatrixWorld(true);
gltf.scene.traverse((node) => {
    if (!node.isSkinnedMesh) return;
    node.computeBoundingBox();
    const { min, max } = node.boundingBox;
    told.meshes.push({ name: node.name, low: min.toArray(), high: max.toArray(),
                       morphs: Object.keys(node.morphTargetDictionary ?? {}).length });
    told.materials.push(node.material.type);
});

// How far the end of the hair goes from its place in the head's frame, metres: at rest, just after
// the head has turned by 60 degrees, and long after.
function swing(vrm) {
    const joints = [...vrm.springBoneManager.joints];
    const end = joints[joints.length - 1].child ?? joints[joints.length - 1].bone;
    const head = vrm.humanoid.getRawBoneNode("head");
    const place = () => {
        vrm.scene.updateMatrixWorld(true);
        return head.worldToLocal(end.getWorldPosition(new THREE.Vector3()));
    };
    const run = (frames) => {
        for (let f = 0; f < frames; ++f) vrm.springBoneManager.update(1 / 60);
        return place().distanceTo(first);
    };
    const first = place();
    const rest = run(120);
    head.rotateY(Math.PI / 3);
    return { joints: joints.length, rest, turned: run(2), settled: run(300) };
}

const vrm = gltf.userData.vrm;
if (vrm) {
    told.meta = vrm.meta;
    told.bones = Object.keys(vrm.humanoid.humanBones).length;
    told.expressions = vrm.expressionManager?.expressions.length ?? 0;
    const springs = vrm.springBoneManager?.joints.size ?? 0;
    if (springs > 0) told.springs = swing(vrm);
}
console.log(JSON.stringify(told));
