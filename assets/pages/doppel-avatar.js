// <doppel-avatar src="avatar.glb">: an avatar that `doppel export --web` wrote, to be turned, played
// and posed in a page. Any glTF binary with one skin does.
//
//   src         address of the .glb, or "#id" of an element that holds its bytes as base64
//   motion      name or number (from 1) of the motion that is shown first; "none": the T-pose
//   autoplay    the motion plays from the beginning, unless the system asks for less motion
//   background  any CSS background; without it the page shines through
//   camera      "AZIMUTH ELEVATION DISTANCE": degrees from the front to the figure's left, degrees
//               up, metres; without it the whole figure is seen
//   target      "X Y Z", metres: what the camera looks at
//   fov         degrees from the top of the picture to its bottom; 30
//   controls    "off": no panel
//   ground      "off": no grid
//
// Events: load and error. `ready` is a promise for the first picture. play(), pause(), reset(),
// setJoint(name, [x, y, z]) in degrees, and `time` in seconds do what the panel does.
import {
    AnimationMixer, Euler, GridHelper, HemisphereLight, MathUtils, PerspectiveCamera, Quaternion,
    Scene, Spherical, Vector3, WebGLRenderer,
} from './three/three.module.min.js';
import { GLTFLoader } from './three/GLTFLoader.js';
import { OrbitControls } from './three/OrbitControls.js';

const TILE = 0.5;  // of the ground, metres
const AXES = [['x', 'left and right'], ['y', 'up'], ['z', 'forward']];

const MARKUP = `
<style>
:host { display: block; container-type: size; width: 100%; height: 32rem;
    --ink: #1d2329; --line: #8a949e; --sheet: #f3f4f6; --accent: #0b62b0;
    color: var(--ink); font: .9375rem/1.4 system-ui, sans-serif; color-scheme: light; }
:host([hidden]) { display: none; }
@media (prefers-color-scheme: dark) { :host { --ink: #e6e9ec; --line: #76818c; --sheet: #22272d;
    --accent: #7fbdf5; color-scheme: dark; } }
.all { display: flex; width: 100%; height: 100%; }
.stage { position: relative; flex: 1 1 auto; min-width: 0; min-height: 0; overflow: hidden; }
canvas { position: absolute; inset: 0; display: block; width: 100%; height: 100%; cursor: grab; }
canvas:active { cursor: grabbing; }
.message { position: absolute; inset: 0; display: grid; place-content: center; margin: 1rem;
    text-align: center; pointer-events: none; }
.panel { box-sizing: border-box; flex: 0 0 17rem; padding: .75rem 1rem; overflow: auto;
    background: var(--sheet); }
:host([controls=off]) .panel, .panel[hidden], .message:empty { display: none; }
fieldset { margin: 0 0 .75rem; padding: 0; border: 0; min-width: 0; }
legend { padding: 0; font-weight: 600; }
label { display: block; margin-top: .375rem; }
.row { display: flex; gap: .5rem; align-items: center; justify-content: space-between; }
output { font-variant-numeric: tabular-nums; }
select, button { box-sizing: border-box; font: inherit; color: inherit; height: 2.25rem; }
select { flex: 1 1 0; min-width: 0; }
input { width: 100%; accent-color: var(--accent); }
input { display: block; margin: .125rem 0 0; height: 1.5rem; }
button { padding: 0 .75rem; border: 1px solid var(--line);
    border-radius: .375rem; background: transparent; cursor: pointer; }
button:disabled { opacity: .5; cursor: default; }
:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
canvas:focus-visible { outline-offset: -3px; }
@container (max-width: 40rem) {
    .all { flex-direction: column; }
    .panel { flex: 0 1 auto; max-height: 45%; }
}
</style>
<div class="all">
  <div class="stage">
    <canvas tabindex="0" role="application" aria-label="Avatar. Arrow keys turn the view, plus and minus
      bring it nearer and further."></canvas>
    <p class="message" role="status">Loading…</p>
  </div>
  <div class="panel" hidden>
    <fieldset class="motion">
      <legend>Motion</legend>
      <div class="row"><select class="motions" aria-label="Motion"></select>
        <button class="play" type="button">Play</button></div>
      <label><span class="row"><span>Time</span><output class="at"></output></span>
        <input class="time" type="range" min="0" step="any" value="0"></label>
    </fieldset>
    <fieldset>
      <legend>Joint</legend>
      <div class="row"><select class="joints" aria-label="Joint"></select>
        <button class="one" type="button" aria-label="Reset joint">Reset</button></div>
      ${AXES.map(([axis, way]) => `
      <label><span class="row"><span>About ${axis} (${way})</span><output class="says-${axis}"></output></span>
        <input class="angle-${axis}" type="range" min="-180" max="180" step="1" value="0"></label>`)
        .join('')}
    </fieldset>
    <button class="everything" type="button">Reset pose and view</button>
  </div>
</div>`;

// Numbers of an attribute, or null where it does not hold as many.
function numbers(text, count) {
    const found = text?.match(/[^\s,]+/g)?.map(Number) ?? [];
    return found.length === count && found.every(Number.isFinite) ? found : null;
}

async function readFile(src) {
    if (src.startsWith('#')) {
        const holder = document.getElementById(src.slice(1));
        if (!holder) throw new Error(`no element ${src} in this page`);
        return Uint8Array.from(atob(holder.textContent.trim()), c => c.charCodeAt(0)).buffer;
    }
    const answer = await fetch(src);
    if (!answer.ok) throw new Error(`${src}: the server says ${answer.status}`);
    return answer.arrayBuffer();
}

export class DoppelAvatar extends HTMLElement {
    static observedAttributes = ['src', 'background', 'motion'];

    #root = this.attachShadow({ mode: 'open' });
    #shown = null;     // what was loaded; null before and after
    #loading = 0;      // counts loads, so that only the last one counts
    #frame = 0;        // the requested animation frame
    #before = 0;       // when the frame before was drawn, in milliseconds
    #isPlaying = false;
    #tellReady;

    constructor() {
        super();
        this.#root.innerHTML = MARKUP;
        this.ready = new Promise(resolve => { this.#tellReady = resolve; });
        this.#listen();
    }

    connectedCallback() {
        this.#showBackground();
        this.#load();
    }
    disconnectedCallback() { this.#unload(); }

    attributeChangedCallback(name, before, now) {
        if (before === now || !this.isConnected) return;
        if (name === 'src') this.#load();
        if (name === 'background') this.#showBackground();
        if (name === 'motion' && this.#shown) this.#choose(this.#motionByAttribute());
    }

    // ---- for scripts -------------------------------------------------------------------------

    get joints() { return this.#shown?.joints.map(joint => joint.name) ?? []; }
    get motions() { return this.#shown?.clips.map(clip => clip.name) ?? []; }
    get playing() { return this.#isPlaying; }
    get time() { return this.#shown?.action?.time ?? 0; }
    set time(seconds) {
        const action = this.#shown?.action;
        if (!action || !Number.isFinite(seconds)) return;
        action.time = MathUtils.clamp(seconds, 0, action.getClip().duration);
        this.#draw();
    }

    play() {
        if (!this.#shown?.action || this.#shown.action.getClip().duration === 0) return;
        this.#isPlaying = true;
        this.#before = 0;
        this.#tellMotion();
        this.#draw();
    }
    pause() {
        this.#isPlaying = false;
        this.#tellMotion();
    }

    // Angles in degrees about the joint's own axes, first x, then y, then z, which come on top of
    // what the motion does.
    setJoint(name, angles) {
        const joint = this.#shown?.joints.find(one => one.name === name);
        if (!joint) throw new Error(`no joint ${name}; there are ${this.joints.join(', ')}`);
        joint.angles = angles.map(Number);
        joint.added.setFromEuler(new Euler(...joint.angles.map(MathUtils.degToRad), 'XYZ'));
        if (this.#part('.joints').value === name) this.#tellJoint();
        this.#draw();
    }

    reset() {
        for (const name of this.joints) this.setJoint(name, [0, 0, 0]);
        if (this.#shown) this.#lookFirst();
        this.#draw();
    }

    // ---- loading -----------------------------------------------------------------------------

    #part(selector) { return this.#root.querySelector(selector); }

    #say(text, isFailure = false) {
        const message = this.#part('.message');
        message.setAttribute('role', isFailure ? 'alert' : 'status');
        message.textContent = text;
    }

    #showBackground() { this.#part('.stage').style.background = this.getAttribute('background') ?? ''; }

    async #load() {
        this.#unload();
        const mine = ++this.#loading;
        const src = this.getAttribute('src');
        if (!src) {
            this.#say('');
            return;
        }
        this.#say('Loading…');
        try {
            // three.js would complain on the console where there is none.
            if (!document.createElement('canvas').getContext('webgl2'))
                throw new Error('this browser shows no 3D graphics (WebGL 2)');
            const bytes = await readFile(src);
            const file = await new GLTFLoader().parseAsync(bytes, '');
            if (mine !== this.#loading || !this.isConnected) return;
            this.#show(file);
            this.#say('');
            this.dispatchEvent(new Event('load'));
        } catch (error) {
            if (mine !== this.#loading) return;
            this.#unload();
            this.#say(`The avatar cannot be shown: ${error.message}`, true);
            this.dispatchEvent(new ErrorEvent('error', { error, message: error.message }));
        }
    }

    #show(file) {
        // A canvas whose context was given up draws no more.
        const old = this.#part('canvas'), canvas = old.cloneNode();
        old.replaceWith(canvas);
        canvas.addEventListener('keydown', event => this.#turnByKey(event));
        const renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
        const camera = new PerspectiveCamera(30, 1, 0.05, 200);
        const scene = new Scene();
        const orbit = new OrbitControls(camera, canvas);
        orbit.minDistance = 0.2;
        orbit.maxDistance = 50;
        const shown = { renderer, camera, scene, orbit, clips: file.animations, action: null };
        this.#shown = shown;

        let skeleton = null;
        scene.add(file.scene, new HemisphereLight(0xffffff, 0x888888, 3));
        file.scene.traverse(node => {
            if (!node.isSkinnedMesh) return;
            node.frustumCulled = false;  // bounds are those of the rest pose
            skeleton ??= node.skeleton;
        });
        if (!skeleton) throw new Error('the file has no skin');
        shown.joints = skeleton.bones.map(bone => ({
            bone, name: bone.userData.name ?? bone.name, angles: [0, 0, 0], added: new Quaternion(),
            moved: bone.quaternion.clone(),
        }));
        shown.mixer = new AnimationMixer(file.scene);
        shown.pelvis = new Vector3();

        const choices = shown.clips.map((clip, i) => new Option(clip.name || `motion ${i + 1}`, i));
        this.#part('.motions').replaceChildren(new Option('T-pose', 'none'), ...choices);
        this.#part('.motion').hidden = choices.length === 0;
        this.#part('.joints').replaceChildren(
            ...shown.joints.map(({ name }) => new Option(name.replaceAll('_', ' '), name)));
        this.#part('.panel').hidden = false;

        this.#choose(this.#motionByAttribute());
        this.#tellJoint();
        shown.colours = matchMedia('(prefers-color-scheme: dark)');
        shown.onColours = () => this.#layGround();
        shown.colours.addEventListener('change', shown.onColours);
        this.#layGround();
        this.#fitSize();
        this.#lookFirst();
        orbit.addEventListener('change', () => this.#draw());
        shown.sizes = new ResizeObserver(() => {
            this.#fitSize();
            this.#draw();
        });
        shown.sizes.observe(this.#part('.stage'));
        const still = matchMedia('(prefers-reduced-motion: reduce)').matches;
        if (this.hasAttribute('autoplay') && !still) this.play();
        this.#draw();
    }

    #unload() {
        cancelAnimationFrame(this.#frame);
        this.#frame = 0;
        this.#isPlaying = false;
        const shown = this.#shown;
        this.#shown = null;
        this.#part('.panel').hidden = true;
        if (!shown) return;
        shown.sizes?.disconnect();
        shown.colours?.removeEventListener('change', shown.onColours);
        shown.orbit.dispose();
        shown.scene.traverse(node => {
            node.geometry?.dispose();
            node.material?.map?.dispose();
            node.material?.dispose();
        });
        shown.renderer.dispose();
    }

    // ---- what is seen ------------------------------------------------------------------------

    #layGround() {
        const { scene } = this.#shown;
        this.#shown.ground?.removeFromParent();
        this.#shown.ground?.dispose();
        if (this.getAttribute('ground') !== 'off') {
            const ink = getComputedStyle(this.#part('.panel')).color;
            const ground = this.#shown.ground = new GridHelper(6, 6 / TILE, ink, ink);
            ground.material.transparent = true;
            ground.material.opacity = 0.18;
            ground.material.depthWrite = false;
            scene.add(ground);
        }
        this.#draw();
    }

    #fitSize() {
        const { renderer, camera } = this.#shown;
        const { clientWidth, clientHeight } = this.#part('.stage');
        if (!clientWidth || !clientHeight) return;
        renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
        renderer.setSize(clientWidth, clientHeight, false);
        camera.aspect = clientWidth / clientHeight;
        camera.updateProjectionMatrix();
    }

    // The camera as the attributes say, or so that all of the motion that is shown is in the picture.
    #lookFirst() {
        const { camera, orbit, pelvis } = this.#shown;
        camera.fov = numbers(this.getAttribute('fov'), 1)?.[0] ?? 30;
        camera.updateProjectionMatrix();
        const reach = this.#reach();
        const [azimuth, elevation, distance] = numbers(this.getAttribute('camera'), 3) ?? [15, 6, 0];
        const target = numbers(this.getAttribute('target'), 3);
        if (target) orbit.target.set(...target);
        else orbit.target.set(pelvis.x, (reach.low + reach.high) / 2, pelvis.z);
        const slope = Math.tan(MathUtils.degToRad(camera.fov / 2));
        const tall = (reach.high - reach.low) / 2 / slope;
        const wide = reach.wide / (slope * camera.aspect);
        const away = new Spherical(distance || Math.max(tall, wide) + reach.wide / 2,
            MathUtils.degToRad(90 - elevation), MathUtils.degToRad(azimuth));
        camera.position.setFromSpherical(away).add(orbit.target);
        orbit.update();
    }

    // How low, high and far from the pelvis the joints get, with the flesh around them.
    #reach() {
        const { action, joints } = this.#shown, place = new Vector3(), pelvis = new Vector3();
        const reach = { low: Infinity, high: -Infinity, wide: 0 };
        const duration = action?.getClip().duration ?? 0, kept = this.time;
        const count = duration > 0 ? 16 : 1;
        for (let i = 0; i < count; ++i) {
            if (count > 1) action.time = duration * i / count;
            this.#pose(0);
            joints[0].bone.getWorldPosition(pelvis);
            for (const { bone } of joints) {
                bone.getWorldPosition(place);
                reach.low = Math.min(reach.low, place.y - 0.12);
                reach.high = Math.max(reach.high, place.y + 0.22);
                reach.wide = Math.max(reach.wide, Math.hypot(place.x - pelvis.x, place.z - pelvis.z) + 0.15);
            }
        }
        if (action) action.time = kept;
        this.#pose(0);
        joints[0].bone.getWorldPosition(this.#shown.pelvis);
        return reach;
    }

    // The pose of the motion `seconds` on, with what was added to the joints.
    #pose(seconds) {
        const { joints, mixer, scene } = this.#shown;
        // The mixer leaves out what has not changed since it wrote it.
        for (const { bone, moved } of joints) bone.quaternion.copy(moved);
        mixer.update(seconds);
        for (const { bone, moved, added } of joints) {
            moved.copy(bone.quaternion);
            bone.quaternion.multiply(added);
        }
        scene.updateMatrixWorld();
    }

    #draw() {
        if (this.#frame || !this.#shown) return;
        this.#frame = requestAnimationFrame(now => {
            this.#frame = 0;
            const { renderer, scene, camera, orbit, joints, pelvis, action } = this.#shown;
            const seconds = this.#isPlaying && this.#before ? (now - this.#before) / 1000 : 0;
            this.#before = now;
            // A page that was hidden goes on where it was.
            this.#pose(Math.min(seconds, 0.25));
            // The camera goes along, so that nobody walks out of the picture.
            const place = joints[0].bone.getWorldPosition(new Vector3());
            const path = place.clone().sub(pelvis).setY(0);
            pelvis.copy(place);
            if (path.lengthSq() > 0) {
                camera.position.add(path);
                orbit.target.add(path);
                orbit.update();
            }
            // So does the ground, by whole tiles: it has no end.
            this.#shown.ground?.position.set(
                Math.round(place.x / TILE) * TILE, 0, Math.round(place.z / TILE) * TILE);
            renderer.render(scene, camera);
            if (action) this.#tellTime();
            this.#tellReady(this);
            if (this.#isPlaying) this.#draw();
        });
    }

    // ---- the panel ---------------------------------------------------------------------------

    #listen() {
        this.#part('.motions').addEventListener('change', event => {
            const { value } = event.target;
            this.#choose(value === 'none' ? -1 : Number(value));
        });
        this.#part('.play').addEventListener('click', () => this.#isPlaying ? this.pause() : this.play());
        this.#part('.time').addEventListener('input', event => {
            const { value } = event.target;  // which is told the present time when it pauses
            this.pause();
            this.time = Number(value);
        });
        this.#part('.joints').addEventListener('change', () => this.#tellJoint());
        for (const [axis] of AXES)
            this.#part(`.angle-${axis}`).addEventListener('input', () => this.setJoint(
                this.#part('.joints').value,
                AXES.map(([each]) => this.#part(`.angle-${each}`).value)));
        this.#part('.one').addEventListener(
            'click', () => this.setJoint(this.#part('.joints').value, [0, 0, 0]));
        this.#part('.everything').addEventListener('click', () => this.reset());
    }

    #motionByAttribute() {
        const { clips } = this.#shown, wanted = this.getAttribute('motion');
        if (wanted === 'none') return -1;
        const named = clips.findIndex(clip => clip.name === wanted);
        const numbered = Number.parseInt(wanted ?? '', 10) - 1;
        return named >= 0 ? named : clips[numbered] ? numbered : Math.min(0, clips.length - 1);
    }

    // A clip by its place in the list; -1: the T-pose.
    #choose(index) {
        const { mixer, clips, joints } = this.#shown;
        // Stopped first, the mixer puts back what it found; joints are to be as it left them.
        for (const { bone, moved } of joints) bone.quaternion.copy(moved);
        mixer.stopAllAction();
        for (const { bone, moved } of joints) moved.copy(bone.quaternion);
        const clip = clips[index];
        this.#shown.action = clip ? mixer.clipAction(clip).reset().play() : null;
        this.#part('.motions').value = clip ? index : 'none';
        if (!clip || clip.duration === 0) this.#isPlaying = false;
        this.#tellMotion();
        this.#draw();
    }

    #tellMotion() {
        const duration = this.#shown?.action?.getClip().duration ?? 0;
        const play = this.#part('.play'), time = this.#part('.time');
        play.textContent = this.#isPlaying ? 'Pause' : 'Play';
        play.disabled = time.disabled = duration === 0;
        time.max = duration || 1;
        this.#tellTime();
    }
    #tellTime() {
        const said = `${this.time.toFixed(2)} s`, time = this.#part('.time');
        time.value = this.time;
        time.setAttribute('aria-valuetext', said);
        this.#part('.at').textContent = said;
    }

    #tellJoint() {
        const joint = this.#shown?.joints.find(one => one.name === this.#part('.joints').value);
        AXES.forEach(([axis], i) => {
            const angle = joint?.angles[i] ?? 0, slider = this.#part(`.angle-${axis}`);
            slider.value = angle;
            slider.setAttribute('aria-valuetext', `${angle} degrees`);
            this.#part(`.says-${axis}`).textContent = `${angle}°`;
        });
    }

    #turnByKey(event) {
        const turns = {
            ArrowLeft: [-1, 0, 1], ArrowRight: [1, 0, 1], ArrowUp: [0, -1, 1], ArrowDown: [0, 1, 1],
            '+': [0, 0, 1 / 1.1], '=': [0, 0, 1 / 1.1], '-': [0, 0, 1.1],
        };
        const turn = turns[event.key];
        if (!turn || !this.#shown || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        const { camera, orbit } = this.#shown;
        const away = new Spherical().setFromVector3(camera.position.clone().sub(orbit.target));
        away.theta += turn[0] * Math.PI / 36;
        away.phi += turn[1] * Math.PI / 36;
        away.radius *= turn[2];
        camera.position.setFromSpherical(away.makeSafe()).add(orbit.target);
        orbit.update();
    }
}

customElements.define('doppel-avatar', DoppelAvatar);
