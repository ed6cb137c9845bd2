// Runs a network in ONNX Runtime: node run.js scene.json
//
// scene.json: "model", a file; "inputs": [{"name", "shape", "file"}], files of float32 as they lie in
// memory; "output", the file that the only result is written to, likewise. Prints the
// result's shape as JSON.

const fs = require("fs");
const runtime = require("onnxruntime-node");

function floats(file) {
    const bytes = fs.readFileSync(file);
    return new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
}

async function main() {
    const asked = JSON.parse(fs.readFileSync(process.argv[2]));
    const session = await runtime.InferenceSession.create(asked.model);
    const feeds = {};
    for (const { name, shape, file } of asked.inputs)
        feeds[name] = new runtime.Tensor("float32", floats(file), shape);
    const results = await session.run(feeds);
    const { data, dims } = results[session.outputNames[0]];
    fs.writeFileSync(asked.output, Buffer.from(data.buffer, data.byteOffset, data.byteLength));
    console.log(JSON.stringify(dims));
}

main().catch((error) => {
    console.error(error);
    process.exit(1);
});
