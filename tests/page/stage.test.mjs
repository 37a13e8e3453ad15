// What arrives: bundles, meshes, the playout of a stream, takes, the picture's rectangle, overlays.
import assert from "node:assert/strict";
import {readFileSync} from "node:fs";
import {test} from "node:test";
import {Identity, waitBefore} from "../../nodes/web/page/connection.js";
import {forwardKinematics, quatMultiply} from "../../nodes/web/page/maths.js";
import {ears, lay, placed, ribbon, Sheet} from "../../nodes/web/page/overlays.js";
import {controlOf, stepOf} from "../../nodes/web/page/params.js";
import {Pace} from "../../nodes/web/page/pace.js";
import {mixPoses, Playout, Track} from "../../nodes/web/page/playout.js";
import {Samples} from "../../nodes/web/page/stats.js";
import {clockText, frameAt, lengthOf, Player, readTrack, takeName} from "../../nodes/web/page/takes.js";
import {DEFAULT_CAMERA, letterbox, lookAt, project, shareOf, viewOf} from "../../nodes/web/page/view.js";
import {acknowledge, readBundle, readCamera, readMesh, readOverlay, readPose} from "../../nodes/web/page/wire.js";

const near = (a, b, e = 1e-5) => assert.ok(Math.abs(a - b) < e, `${a} is not ${b}`);
/** Written by tests/nodes/test_web_page_logic.py with the server's own code. */
const sample = process.env.BUNRAKU_PAGE_SAMPLE;
const bytes = (name) => {
  const data = readFileSync(`${sample}/${name}`);
  return data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
};
const told = sample ? JSON.parse(readFileSync(`${sample}/told.json`, "utf8")) : null;
const fromServer = {skip: sample ? false : "run by tests/nodes/test_web_page_logic.py"};

test("the server's bundle reads as what was sent", fromServer, () => {
  const {number, parts} = readBundle(bytes("bundle.bin"));
  assert.equal(number, told.number);
  assert.deepEqual(parts.map(({kind, figure}) => [kind, figure]), [[1, 0], [2, 0], [3, 0], [1, 1]]);
  const pose = readPose(parts[0].view);
  assert.deepEqual([pose.seq, pose.feet, pose.stamp], [told.pose.seq, told.pose.feet, told.pose.stamp]);
  near(pose.echo, told.pose.echo);
  pose.root.forEach((v, i) => near(v, told.pose.root[i]));
  pose.rotations.forEach((v, i) => near(v, told.pose.rotations[i], 2e-5));
  assert.ok(Number.isNaN(readPose(parts[3].view).echo));
  const camera = readCamera(parts[1].view);
  camera.position.forEach((v, i) => near(v, told.camera.position[i]));
  camera.rotation.forEach((v, i) => near(v, told.camera.rotation[i]));
  near(camera.yfov, told.camera.yfov); assert.equal(camera.orthoHeight, 0); near(camera.aspect, told.camera.aspect);
  const overlay = readOverlay(parts[2].view);
  assert.equal(overlay.topic, "overlay/test");
  assert.deepEqual(overlay.primitives.map(({kind, label, count}) => [kind, label, count]), told.overlay);
  assert.deepEqual([...overlay.primitives[1].points].map((v) => Math.round(v * 10) / 10), [1, 2, 3, 4, 5, 6]);
});

test("the server's mesh reads as what was built", fromServer, () => {
  const mesh = readMesh(bytes("mesh.bin"));
  assert.deepEqual([mesh.vertices, mesh.indices.length / 3, mesh.capsules.length], told.mesh.counts);
  for (const [i, place, joint] of told.mesh.vertices) {
    assert.equal(mesh.positions[4 * i + 3], joint);
    place.forEach((v, k) => near(mesh.positions[4 * i + k] * mesh.scale, v, 6e-5));
  }
  for (const [i, corners] of told.mesh.triangles) assert.deepEqual([...mesh.indices.subarray(3 * i, 3 * i + 3)], corners);
  for (const [i, color] of told.mesh.colors) color.forEach((v, k) => assert.ok(Math.abs(mesh.colors[4 * i + k] - v) <= 1));
  for (const [i, normal] of told.mesh.normals) normal.forEach((v, k) => near(mesh.normals[4 * i + k] / 127, v, 5e-3));
});

test("forward kinematics agrees with the stage's own", fromServer, () => {
  const {parents, offsets, root, rotations, positions} = told.fk;
  const q = new Float32Array(rotations.length), p = new Float32Array(3 * parents.length);
  forwardKinematics(parents, offsets, root, rotations, q, p);
  p.forEach((v, i) => near(v, positions[i], 1e-5));
});

test("projection agrees with the stage's own", fromServer, () => {
  const view = viewOf({...told.camera, stamp: 0, orthoHeight: 0});
  for (const [point, share] of told.projected) {
    const {x, y} = project(view, point);
    near(x, share[0]); near(y, share[1]);
  }
});

test("the server's take reads as what was recorded", fromServer, () => {
  const track = readTrack(bytes("track.bin"));
  assert.deepEqual([track.times.length, track.joints], told.track.counts);
  near(lengthOf(track), told.track.length, 1e-3);
  const {root} = frameAt(track, told.track.at);
  root.forEach((v, i) => near(v, told.track.root[i], 1e-4));
});

test("a bundle that is cut short is refused", () => {
  assert.throws(() => readBundle(new Uint8Array([1, 0, 0, 0, 1, 0, 0, 0, 99, 0, 0, 0]).buffer), RangeError);
  assert.equal(new DataView(acknowledge(70000)).getUint32(0, true), 70000);
});

const pose = (stamp, x, w = 1) => ({stamp, echo: NaN, seq: 0, feet: 0, root: new Float32Array([x, 0, 0]), rotations: new Float32Array([0, Math.sqrt(1 - w * w), 0, w])});

test("between two poses the figure glides, over a leap or a pause it does not", () => {
  const track = new Track();
  track.push(pose(0, 0)); track.push(pose(20, 0.2, Math.SQRT1_2));
  const half = mixPoses(track.around(10));
  near(half.root[0], 0.1); near(2 * Math.atan2(half.rotations[1], half.rotations[3]), Math.PI / 4, 1e-3);
  near(mixPoses(track.around(-5)).root[0], 0);
  near(mixPoses(track.around(99)).root[0], 0.2);
  track.push(pose(40, 3));
  near(mixPoses(track.around(30)).root[0], 3);
  track.push(pose(900, 3.2));
  near(mixPoses(track.around(500)).root[0], 3.2);
});

test("a stage that begins again is shown from its beginning", () => {
  const track = new Track();
  track.push(pose(100000, 1)); track.push(pose(100016, 1)); track.push(pose(100016, 5));
  assert.equal(track.samples.length, 2);
  track.push(pose(5, 2));
  assert.deepEqual([track.samples.length, track.newest.root[0]], [1, 2]);
});

/** Feeds a stream with given lateness, and gives the delay that the playout settles at. */
function settle(interval, late) {
  const playout = new Playout();
  for (let i = 0; i < 400; i++) playout.heard(1e12 + i * interval, 5000 + i * interval + late(i));
  return playout;
}

test("a steady stream is shown at once, an uneven one late enough, a slow one an interval late", () => {
  assert.ok(settle(16.67, () => 3).delay < 1);
  const uneven = settle(16.67, (i) => (i % 3 ? 0 : 25)).delay;
  assert.ok(uneven > 18 && uneven < 40, uneven);
  const slow = settle(40, () => 3).delay;
  assert.ok(slow > 35 && slow < 50, slow);
  assert.ok(settle(16.67, () => Math.random() * 1000).delay <= 120);
  const playout = settle(16.67, () => 3);
  near(playout.at(6000), 6000 - playout.offset - playout.delay);
});

test("the letterbox keeps the camera's aspect, and a place on it is a share", () => {
  assert.deepEqual(letterbox(2, 1000, 1000), {left: 0, top: 250, width: 1000, height: 500});
  assert.deepEqual(letterbox(1, 1000, 400), {left: 300, top: 0, width: 400, height: 400});
  assert.deepEqual(shareOf({left: 300, top: 10, width: 400, height: 400}, 500, 210), {x: 0.5, y: 0.5});
});

test("a camera that looks at a place has it in the middle", () => {
  const view = viewOf({...DEFAULT_CAMERA, position: [3, 2, -4], rotation: lookAt([3, 2, -4], [0.5, 0.2, 1])});
  const {x, y, depth} = project(view, [0.5, 0.2, 1]);
  near(x, 0.5); near(y, 0.5); assert.ok(depth > 0);
  assert.ok(project(view, [0.5, 0.9, 1]).y < 0.5);
  const flat = viewOf({...DEFAULT_CAMERA, orthoHeight: 2, yfov: 0, position: [0, 1, 5], rotation: lookAt([0, 1, 5], [0, 1, 0])});
  near(project(flat, [0, 2, 0]).y, 0); near(project(flat, [1, 1, -3]).x, 0.5 + 0.5 / DEFAULT_CAMERA.aspect);
});

const primitive = (fields) => ({kind: "line", space: "screen", color: [1, 0, 0, 1], size: 0.1, label: "", dim: 2, points: new Float32Array(), ...fields});
const box = {x: 0.5, y: 0.5, width: 0.5, height: 0.5};
const letters = {least: 0.01, line: (text) => ({width: text.length, glyphs: [...text].map((_, i) => ({x: i, w: 1, u: [0, 0, 1, 1]}))})};
const draw = (fields) => {
  const sheets = {ground: new Sheet(), world: new Sheet(), picture: new Sheet()};
  lay(sheets, primitive(fields), viewOf(DEFAULT_CAMERA), 2, box, letters, [-1, 0, 1]);
  return sheets;
};
const extent = (sheet, k) => {
  const all = Array.from({length: sheet.count}, (_, i) => sheet.data[6 * i + k]);
  return [Math.min(...all), Math.max(...all)];
};

test("points of the picture keep lengths equal both ways, a panel's lie in its box", () => {
  assert.deepEqual(placed(primitive({points: new Float32Array([0.5, 0.25])}), 2, box), [[1, 0.25, 0]]);
  assert.deepEqual(placed(primitive({space: "panel", points: new Float32Array([1, 1])}), 2, box), [[2, 1, 0]]);
  assert.deepEqual(placed(primitive({space: "world", dim: 3, points: new Float32Array([1, 2, 3])}), 2, box), [[1, 2, 3]]);
});

test("every kind of primitive is drawn where it is", () => {
  const line = draw({points: new Float32Array([0.1, 0.5, 0.4, 0.5])}).picture;
  assert.deepEqual(extent(line, 0).map((v) => Math.round(v * 100)), [20, 80]);
  assert.deepEqual(extent(line, 1).map((v) => Math.round(v * 100)), [45, 55]);
  const circle = draw({kind: "circle", points: new Float32Array([0.5, 0.5])}).picture;
  assert.deepEqual(extent(circle, 0).map((v) => Math.round(v * 100)), [90, 110]);
  const ring = draw({kind: "circle", space: "world", dim: 3, points: new Float32Array([0, 0, 0]), size: 0.5}).ground;
  assert.deepEqual(extent(ring, 0).map((v) => Math.round(v * 100)), [-50, 50]);
  assert.ok(extent(ring, 1)[1] < 0.02);
  for (const kind of ["points", "polygon", "figure"]) {
    const sheets = draw({kind, space: "world", dim: 3, points: new Float32Array([0, 0, 0, 1, 0, 0, 1, 1, 0])});
    assert.ok(sheets.world.count > 0 && sheets.picture.count === 0 && sheets.ground.count === 0, kind);
  }
  const bar = draw({kind: "bar", points: new Float32Array([0, 0.5, 0.5, 0.5]), size: 0.5}).picture;
  assert.equal(bar.count, 12);
  const text = draw({kind: "text", label: "abc", points: new Float32Array([0.5, 0.5]), size: 0.05}).picture;
  assert.equal(text.count, 18);
  assert.ok(draw({label: "hand", space: "world", dim: 3, points: new Float32Array([0, 1, 0, 1, 1, 0])}).picture.count === 24);
});

test("a hollow polygon is filled where it is and nowhere else, in any plane and direction", () => {
  const flat = [[0, 0], [4, 0], [4, 3], [3, 3], [3, 1], [1, 1], [1, 3], [0, 3]]; // a U: its hull holds 4 more
  for (const lift of [([x, y]) => [x, y, 1], ([x, y]) => [2, x, y], ([x, y]) => [y, 0, x]]) {
    for (const shape of [flat.map(lift), flat.map(lift).reverse()]) {
      let area = 0;
      for (const [a, b, c] of ears(shape)) {
        const [p, q] = [b, c].map((i) => shape[i].map((v, k) => v - shape[a][k]));
        area += Math.hypot(p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]) / 2;
      }
      near(area, 8);
      assert.equal(ears(shape).length, 6);
    }
  }
  assert.deepEqual(ears([]), []);
  assert.equal(ears([[0, 0, 0], [1, 1, 0], [1, 0, 0], [0, 1, 0]]).length, 2); // crosses itself
});

test("a bent line is one piece of an even width", () => {
  const sheet = new Sheet();
  ribbon(sheet, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 0]], 0.2, null);
  assert.equal(sheet.count, 12);
  let area = 0;
  const at = (i) => [sheet.data[6 * i], sheet.data[6 * i + 1]];
  for (let i = 0; i < sheet.count; i += 3) {
    const [p, q, r] = [at(i), at(i + 1), at(i + 2)];
    area += Math.abs((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])) / 2;
  }
  near(area, 0.4);
  const thin = new Sheet();
  ribbon(thin, [[0, 0, 0], [1, 0, 0]], 0, null, {least: 0.01});
  near(extent(thin, 1)[1], 0.005);
  const back = new Sheet();
  ribbon(back, [[0, 0, 0], [1, 0, 0], [0, 0, 0]], 0.2, null);
  assert.ok(extent(back, 0)[1] < 1.2 && extent(back, 1)[1] < 0.2);
});

test("odd primitives do no harm", () => {
  for (const kind of ["circle", "line", "polygon", "points", "figure", "bar", "text", "surprise"]) {
    draw({kind, label: "x"});
    draw({kind, points: new Float32Array([0.5, 0.5]), label: "x"});
    draw({kind, points: new Float32Array([0.5, 0.5, 0.5, 0.5])});
  }
});

test("a take's clock, its ends and its player", () => {
  assert.deepEqual([clockText(0), clockText(61500), clockText(600000)], ["0:00.0", "1:01.5", "10:00.0"]);
  const track = {times: new Float64Array([0, 100, 200]), roots: new Float32Array([0, 0, 0, 1, 0, 0, 2, 0, 0]), rotations: new Int16Array([0, 0, 0, 32767, 0, 0, 0, 32767, 0, 0, 0, 32767]), joints: 1};
  near(frameAt(track, 50).root[0], 0.5); near(frameAt(track, 999).root[0], 2); near(frameAt(track, -9).root[0], 0);
  const player = new Player();
  assert.equal(player.update(16), null);
  player.load(track); player.toggle();
  near(player.update(150).root[0], 1.5);
  player.update(100);
  assert.deepEqual([player.playing, player.share], [false, 1]);
  player.toggle();
  assert.deepEqual([player.playing, player.time], [true, 0]);
  player.seek(0.25);
  near(player.time, 50);
});

test("waits between tries grow to a limit and differ from page to page", () => {
  const waits = Array.from({length: 12}, (_, i) => waitBefore(i, 0.5));
  assert.ok(waits.every((v, i) => i === 0 || v >= waits[i - 1]) && waits[0] < 400 && waits.at(-1) <= 3000);
  assert.ok(waitBefore(3, 0) < waitBefore(3, 1));
});

test("the token moves from the link into the session, and a page keeps its name", () => {
  const kept = new Map(), shown = [];
  const store = {getItem: (k) => kept.get(k) ?? null, setItem: (k, v) => kept.set(k, v)};
  const history = {replaceState: (_, __, url) => shown.push(url)};
  const first = new Identity(store, {hash: "#t=abc-DEF_1", pathname: "/", search: ""}, history);
  assert.deepEqual([first.token, shown], ["abc-DEF_1", ["/"]]);
  const again = new Identity(store, {hash: "", pathname: "/", search: ""}, history);
  assert.deepEqual([again.token, again.page], [first.token, first.page]);
  assert.match(first.page, /^[0-9a-f]{8}$/);
  assert.notEqual(again.renew(), first.page);
  assert.equal(new Identity({getItem: () => null, setItem() {}}, {hash: "#t=<script>", pathname: "/", search: ""}, history).token, "");
});

test("a parameter gets the control that fits it", () => {
  const one = (fields) => ({value: 1, type: "float", doc: "", low: null, high: null, choices: null, settable: true, ...fields});
  assert.equal(controlOf(one({})), "number");
  assert.equal(controlOf(one({low: 0, high: 2})), "slider");
  assert.equal(controlOf(one({value: true})), "switch");
  assert.equal(controlOf(one({value: "a", choices: ["a", "b"]})), "choice");
  assert.equal(controlOf(one({value: "path"})), "text");
  assert.equal(controlOf(one({settable: false})), "text");
  assert.equal(stepOf(one({low: 0, high: 2})), 0.01);
  assert.equal(stepOf(one({type: "int", low: 0, high: 2})), 1);
});

test("percentiles of the last numbers", () => {
  const samples = new Samples(100);
  assert.ok(Number.isNaN(samples.percentile(0.5)));
  for (let i = 0; i < 250; i++) samples.add(i);
  assert.deepEqual([samples.percentile(0), samples.percentile(0.5), samples.percentile(1)], [150, 200, 249]);
});

test("quaternions multiply as rotations do", () => {
  const out = [0, 0, 0, 0], h = Math.SQRT1_2;
  quatMultiply(out, 0, [0, h, 0, h], 0, [0, h, 0, h], 0);
  out.forEach((v, i) => near(v, [0, 1, 0, 0][i]));
});

/** Frames for so long; `gap` says how long each takes with the pixels that are drawn. */
function frames(pace, from, seconds, gap) {
  let now = from, changes = 0;
  while (now < from + 1000 * seconds) {
    const before = pace.level;
    pace.update(now);
    if (pace.level !== before) changes++;
    now += gap(pace.scale);
  }
  return {now, changes};
}

test("a slow machine draws fewer pixels, in few changes, and all of them again when it is fast", () => {
  const pace = new Pace();
  let {now, changes} = frames(pace, 0, 20, (scale) => 5 + 40 * scale ** 2); // 45 ms with all, 22 with two thirds
  assert.equal(pace.scale, 0.65);
  assert.equal(changes, 2);
  ({now, changes} = frames(pace, now, 60, () => 16.7));
  assert.equal(pace.scale, 1);
  assert.equal(changes, 2);
});

test("a screen that holds every frame twice as long keeps its pixels: fewer are of no use", () => {
  const pace = new Pace();
  const first = frames(pace, 0, 8, () => 33.3);
  assert.equal(pace.scale, 1);
  assert.ok(frames(pace, first.now, 600, () => 33.3).changes <= 60); // tried again now and then
});

test("fewer pixels that are of use are kept on a machine that stays slow with them", () => {
  const pace = new Pace();
  const {changes} = frames(pace, 0, 60, (scale) => 25 + 75 * scale ** 2); // 100 ms with all, 44 with the fewest
  assert.equal(pace.scale, 0.5);
  assert.equal(changes, 3);
});

test("what fits into a refresh only with fewer pixels is found, though the steps before it gain nothing", () => {
  const pace = new Pace();
  frames(pace, 0, 20, (scale) => (scale > 0.5 ? 33.3 : 16.7));
  assert.equal(pace.scale, 0.5);
});

test("more pixels are tried ever more rarely where they prove too many", () => {
  const pace = new Pace();
  let {now} = frames(pace, 0, 60, (scale) => (scale > 0.65 ? 30 : 16.7));
  let changes;
  ({now, changes} = frames(pace, now, 600, (scale) => (scale > 0.65 ? 30 : 16.7)));
  assert.ok(changes <= 14, `${changes}`);
});

test("a page that was not drawn for a while was not slow", () => {
  const pace = new Pace();
  const {now} = frames(pace, 0, 2, () => 16.7);
  for (let k = 1; k < 50; k++) pace.update(now + 2000 * k);
  assert.equal(pace.scale, 1);
});

test("a take is listed by its time, an older one by its day too", () => {
  const now = new Date(2026, 10, 23, 8, 0);
  assert.equal(takeName("take-20261123-071502", now), "07:15:02");
  assert.equal(takeName("take-20261123-071502-2", now), "07:15:02");
  assert.equal(takeName("take-20251123-071502", now), "2025-11-23 07:15");
  assert.equal(takeName("other", now), "other");
});
