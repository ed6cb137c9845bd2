// The vertices of a USD file in a frame of its animation, by three.js:
//
//     node skin.mjs file.usda frame out
//
// out: for each corner of each face, in order, its place as three float32. Exits with 3 where no
// three.js is found that reads skeletons in USD (0.180 and later).

import fs from "node:fs";
import { createRequire } from "node:module";
import { pathToFileURL } from "node:url";
import path from "node:path";

const [file, frame, out] = process.argv.slice(2);

async function threeWithUsd() {
    let folder;
    try {
        folder = path.dirname(path.dirname(createRequire(import.meta.url).resolve("three")));
    } catch {
        process.exit(3);
    }
    const parts = path.join(folder, "examples/jsm/loaders");
    const composer = path.join(parts, "usd/USDComposer.js");
    if (!fs.existsSync(composer) || !/SkinnedMesh/.test(fs.readFileSync(composer))) process.exit(3);
    const load = (at) => import(pathToFileURL(at));
    const THREE = await load(path.join(folder, "build/three.module.js"));
    const { USDLoader } = await load(path.join(parts, "USDLoader.js"));
    return { THREE, USDLoader };
}

const { THREE, USDLoader } = await threeWithUsd();
if (!file) process.exit(0);
// Pictures need a browser; the mesh does not.
THREE.ImageLoader.prototype.load = () => {};

const group = new USDLoader().parse(fs.readFileSync(file, "utf8"));
const meshes = [];
group.traverse((node) => node.isSkinnedMesh && meshes.push(node));
if (meshes.length !== 1) throw new Error(`expected one skinned mesh, found ${meshes.length}`);
const [mesh] = meshes;
if (group.animations?.length) {
    const mixer = new THREE.AnimationMixer(group);
    mixer.clipAction(group.animations[0]).play();
    const times = group.animations[0].tracks[0].times;
    mixer.setTime(times[Number(frame)]);
}
group.updateMatrixWorld(true);
mesh.skeleton.update();
const index = mesh.geometry.index;
const corners = index ? index.count : mesh.geometry.attributes.position.count;
const places = new Float32Array(3 * corners);
const place = new THREE.Vector3();
for (let i = 0; i < corners; ++i) {
    mesh.getVertexPosition(index ? index.getX(i) : i, place);
    place.applyMatrix4(mesh.matrixWorld).toArray(places, 3 * i);
}
fs.writeFileSync(out, Buffer.from(places.buffer));
