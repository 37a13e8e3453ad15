// What hands do on the page becomes frames: fingers, pen, mouse, sliders, gamepad, and the outbox.
import assert from "node:assert/strict";
import {test} from "node:test";
import {Calibration} from "../../nodes/web/page/calibrate.js";
import {fingerKey, SliderHands} from "../../nodes/web/page/hands.js";
import {MouseFingers, MousePen} from "../../nodes/web/page/mouse.js";
import {Outbox} from "../../nodes/web/page/outbox.js";
import {Pads} from "../../nodes/web/page/pad.js";
import {fromTilt, penSample, PenSamples} from "../../nodes/web/page/pen.js";
import {Contacts, ellipse, Force, hasTouchEvents} from "../../nodes/web/page/touch.js";

const finger = (x, y) => ({x, y, major: null, minor: null, angle: null, pressure: null});
const phases = (frame) => frame?.map((one) => [one.id, one.phase]) ?? null;
const near = (a, b, e = 1e-9) => assert.ok(Math.abs(a - b) < e, `${a} is not ${b}`);

test("a finger goes down, moves and leaves; an unchanged frame is not told", () => {
  const contacts = new Contacts();
  contacts.put("t0", finger(0.1, 0.2));
  assert.deepEqual(phases(contacts.frame()), [[1, "down"]]);
  assert.equal(contacts.frame(), null);
  contacts.put("t0", finger(0.2, 0.2));
  contacts.put("t0", finger(0.3, 0.2));
  const [moved] = contacts.frame();
  assert.deepEqual([moved.phase, moved.x], ["move", 0.3]);
  contacts.end("t0", "up");
  assert.deepEqual(phases(contacts.frame()), [[1, "up"]]);
  assert.equal(contacts.frame(), null);
});

test("a tap within one frame is told in two", () => {
  const contacts = new Contacts();
  contacts.put("t0", finger(0.1, 0.2));
  contacts.end("t0", "up");
  assert.deepEqual(phases(contacts.frame()), [[1, "down"]]);
  assert.deepEqual(phases(contacts.frame()), [[1, "up"]]);
});

test("a finger that takes an ended one's name within the frame is another finger", () => {
  const contacts = new Contacts();
  contacts.put("t0", finger(0.1, 0.2));
  contacts.frame();
  contacts.end("t0", "up");
  contacts.put("t0", finger(0.9, 0.9));
  assert.deepEqual(phases(contacts.frame()).sort(), [[1, "up"], [2, "down"]]);
});

test("every frame holds all fingers that are down", () => {
  const contacts = new Contacts();
  contacts.put("t0", finger(0.1, 0.2));
  contacts.put("t1", finger(0.5, 0.5));
  contacts.frame();
  contacts.put("t1", finger(0.6, 0.5));
  assert.deepEqual(phases(contacts.frame()), [[1, "move"], [2, "move"]]);
  assert.deepEqual(phases(contacts.frame(true)), [[1, "move"], [2, "move"]]);
});

test("after a lost connection fingers that are down do nothing until they are put down again", () => {
  const contacts = new Contacts();
  contacts.put("t0", finger(0.1, 0.2));
  contacts.put("t1", finger(0.5, 0.5));
  contacts.frame();
  contacts.end("t1", "up");
  assert.equal(contacts.lose(), true);
  assert.equal(contacts.any, false);
  contacts.put("t0", finger(0.3, 0.3));
  assert.equal(contacts.frame(true), null);
  contacts.put("t2", finger(0.9, 0.9)); // another finger plays
  assert.deepEqual(phases(contacts.frame()), [[3, "down"]]);
  contacts.end("t0", "up");
  assert.deepEqual(phases(contacts.frame(true)), [[3, "move"]]);
  contacts.put("t0", finger(0.3, 0.3));
  assert.deepEqual(phases(contacts.frame()), [[3, "move"], [4, "down"]]);
  contacts.endAll("up");
  contacts.frame();
  assert.equal(contacts.lose(), false);
});

test("after a lost connection a pen hovers until it is lifted and put down again", () => {
  const samples = new PenSamples(), pen = new MousePen(samples);
  pen.put({x: 0.5, y: 0.5}, 1, 1);
  samples.frame();
  assert.equal(samples.lose(), true);
  pen.put({x: 0.6, y: 0.5}, 1, 2);
  assert.deepEqual(samples.frame().map(({x, contact, pressure}) => [x, contact, pressure]), [[0.5, false, 0], [0.6, false, 0]]);
  assert.deepEqual(samples.frame(true), []);
  pen.put({x: 0.6, y: 0.5}, 0, 3);
  pen.put({x: 0.7, y: 0.5}, 1, 4);
  assert.deepEqual(samples.frame().map((one) => one.contact), [false, true]);
  pen.leave(5);
  samples.frame();
  assert.equal(samples.lose(), false);
  assert.deepEqual(samples.frame(), []);
});

test("random fingers: each is told down first, then at most one end, and nothing after", () => {
  let seed = 7;
  const random = (n) => (seed = (seed * 1103515245 + 12345) % 2147483648) % n;
  for (let run = 0; run < 50; run++) {
    const contacts = new Contacts(), state = new Map();
    for (let i = 0; i < 80; i++) {
      const key = `t${random(4)}`;
      if (random(3)) contacts.put(key, finger(random(100) / 100, 0.5));
      else contacts.end(key, "up");
      if (random(2)) continue;
      for (const {id, phase} of contacts.frame() ?? []) {
        const before = state.get(id);
        assert.ok(phase === "down" ? before === undefined : before === "live", `${id} ${before} ${phase}`);
        state.set(id, phase === "up" ? "over" : "live");
      }
    }
    contacts.endAll("cancel");
    for (let i = 0; i < 3; i++) for (const {id, phase} of contacts.frame() ?? []) state.set(id, phase === "cancel" || phase === "up" ? "over" : "live");
    assert.ok([...state.values()].every((one) => one === "over"));
  }
});

test("an ellipse has full axes in metres, and the long one's angle", () => {
  const metre = 0.001;
  let one = ellipse({radiusX: 10, radiusY: 4, rotationAngle: 30}, metre);
  near(one.major, 0.02); near(one.minor, 0.008); near(one.angle, Math.PI / 6);
  one = ellipse({radiusX: 4, radiusY: 10, rotationAngle: 0}, metre);
  near(Math.abs(one.angle), Math.PI / 2);
  near(ellipse({radiusX: 4, radiusY: 10, rotationAngle: 80}, metre).angle, (-10 * Math.PI) / 180);
  assert.deepEqual(ellipse({radiusX: 0, radiusY: 0}, metre), {major: null, minor: null, angle: null});
});

test("a force is told only by a device that has shown more than two values", () => {
  const force = new Force();
  assert.deepEqual([force.read(0), force.read(1), force.read(1), force.read(0)], [null, null, null, null]);
  assert.equal(force.read(0.4), 0.4);
  assert.equal(force.read(1), 1);
  assert.equal(force.read(undefined), null);
});

test("touch events are used where they are", () => {
  assert.equal(hasTouchEvents({TouchEvent: 1, ontouchstart: null}), true);
  assert.equal(hasTouchEvents({TouchEvent: 1, navigator: {maxTouchPoints: 5}}), true);
  assert.equal(hasTouchEvents({TouchEvent: 1, navigator: {maxTouchPoints: 0}}), false);
  assert.equal(hasTouchEvents({navigator: {maxTouchPoints: 5}}), false);
});

test("tilt becomes altitude and azimuth as Chromium computes them", () => {
  // pairs read from Chromium 156: tiltX, tiltY -> altitudeAngle, azimuthAngle
  const back = ({altitude, azimuth}) => [Math.atan(Math.cos(azimuth) / Math.tan(altitude)), Math.atan(Math.sin(azimuth) / Math.tan(altitude))].map((v) => Math.round((v * 180) / Math.PI));
  for (const [x, y] of [[30, -20], [10, 5], [20, -30], [-45, 45], [-1, -89]]) assert.deepEqual(back(fromTilt(x, y)), [x, y]);
  assert.deepEqual(fromTilt(0, 0), {altitude: Math.PI / 2, azimuth: 0});
  near(fromTilt(0, 30).azimuth, Math.PI / 2); near(fromTilt(0, -30).azimuth, 1.5 * Math.PI);
  near(fromTilt(-30, 0).azimuth, Math.PI); near(fromTilt(30, 0).altitude, Math.PI / 3);
  assert.deepEqual(fromTilt(90, 10), {altitude: 0, azimuth: 0});
});

const picture = {left: 100, top: 50, width: 800, height: 400};
const event = (fields) => ({clientX: 500, clientY: 150, pressure: 0.5, buttons: 1, timeStamp: 12, ...fields});

test("a pen's sample has its place on the picture, and native angles where there are any", () => {
  const one = penSample(event({altitudeAngle: 1, azimuthAngle: -0.5, twist: 90, tiltX: 5}), picture, true);
  assert.deepEqual([one.x, one.y, one.contact, one.pressure, one.altitude], [0.5, 0.25, true, 0.5, 1]);
  near(one.azimuth, 2 * Math.PI - 0.5); near(one.twist, Math.PI / 2);
  const hover = penSample(event({buttons: 0, pressure: 0.5, tiltX: 0, tiltY: 45}), picture, false);
  assert.deepEqual([hover.contact, hover.pressure, hover.twist], [false, 0, null]);
  near(hover.altitude, Math.PI / 4);
  const eraser = penSample(event({buttons: 32}), picture, false);
  assert.deepEqual([eraser.eraser, eraser.contact, eraser.buttons], [true, true, 0]);
});

test("a pen that leaves is told once, and a long frame keeps its newest samples", () => {
  const samples = new PenSamples();
  samples.leave(1);
  assert.deepEqual(samples.frame(), []);
  for (let i = 0; i < 500; i++) samples.add(penSample(event({timeStamp: i}), picture, false));
  const told = samples.frame();
  assert.ok(told.length <= 200 && told.at(-1).time === 499);
  assert.equal(samples.frame(true)[0].time, 499);
  samples.leave(600); samples.leave(601);
  const left = samples.frame();
  assert.deepEqual([left.length, left[0].in_range, left[0].contact], [1, false, false]);
});

test("a mouse with Shift pins a finger, drags another, and takes the pin away", () => {
  const contacts = new Contacts(), mouse = new MouseFingers(contacts);
  mouse.down({x: 0.2, y: 0.2}, 1, true); mouse.up();
  mouse.down({x: 0.8, y: 0.8}, 1, false); mouse.move({x: 0.7, y: 0.8}, 1);
  assert.deepEqual(contacts.frame().map(({x, phase}) => [x, phase]), [[0.2, "down"], [0.7, "down"]]);
  mouse.up();
  assert.deepEqual(phases(contacts.frame()), [[1, "move"], [2, "up"]]);
  mouse.down({x: 0.21, y: 0.2}, 1, false); mouse.move({x: 0.4, y: 0.3}, 1); mouse.up();
  assert.deepEqual(contacts.frame().map(({id, x, phase}) => [id, x, phase]), [[1, 0.4, "move"]]);
  mouse.down({x: 0.4, y: 0.3}, 1, true); mouse.move({x: 0.6, y: 0.3}, 1); mouse.up();
  assert.deepEqual(phases(contacts.frame()), [[1, "move"]]);
  mouse.down({x: 0.6, y: 0.3}, 1, true); mouse.up();
  assert.deepEqual(phases(contacts.frame()), [[1, "up"]]);
});

test("the wheel presses harder: pressure and ellipse grow", () => {
  const contacts = new Contacts(), mouse = new MouseFingers(contacts);
  mouse.down({x: 0.5, y: 0.5}, 1, false);
  const [light] = contacts.frame();
  for (let i = 0; i < 5; i++) mouse.wheel(-1);
  const [hard] = contacts.frame();
  assert.ok(hard.pressure > light.pressure && hard.major > light.major && hard.x === light.x);
  for (let i = 0; i < 90; i++) mouse.wheel(-1);
  assert.equal(contacts.frame()[0].pressure, 1);
  mouse.release();
  assert.deepEqual(phases(contacts.frame()), [[1, "up"]]);
});

test("a mouse is a pen that hovers, presses and tilts", () => {
  const samples = new PenSamples(), pen = new MousePen(samples);
  pen.put({x: 0.1, y: 0.1}, 0, 1); pen.put({x: 0.1, y: 0.1}, 1, 2);
  pen.wheel(-4, "pressure", 3); pen.wheel(3, "altitude", 4); pen.wheel(-7, "azimuth", 5);
  const told = samples.frame();
  assert.deepEqual(told.map((one) => one.contact), [false, true, true, true, true]);
  near(told[2].pressure, 0.7); near(told[3].altitude, Math.PI / 2 - Math.PI / 12); near(told[4].azimuth, 1.5 * Math.PI + 5 * Math.PI / 12);
  pen.leave(6);
  assert.equal(samples.frame()[0].in_range, false);
});

test("a double click ramps the left z: -1, then 0 to 1, a moment there, and back", () => {
  const hands = new SliderHands(), seen = [];
  hands.duration = 0.5;
  assert.equal(hands.frame(), null);
  hands.perform();
  for (let i = 0; i < 100; i++) {
    hands.update(0.01);
    seen.push(hands.frame(true).left.position[2]);
  }
  near(seen[0], 0.02, 1e-6); near(seen[24], 0.5, 1e-6); assert.equal(seen[60], 1); assert.equal(seen.at(-1), -1);
  const rise = seen.slice(0, 50);
  assert.ok(rise.every((v, i) => i === 0 || v > rise[i - 1]));
});

test("a finger's key bends it and lets it spring back", () => {
  const hands = new SliderHands();
  assert.deepEqual(fingerKey("Digit2"), {side: "right", finger: 1});
  assert.deepEqual(fingerKey("Digit0"), {side: "left", finger: 4});
  assert.equal(fingerKey("KeyA"), null);
  hands.key("right", 1, 1);
  for (let i = 0; i < 120; i++) hands.update(1 / 60);
  near(hands.hands.right.bend[1], 1, 1e-2);
  hands.key("right", 1, null);
  for (let i = 0; i < 240; i++) hands.update(1 / 60);
  assert.equal(hands.hands.right.bend[1], 0);
  assert.equal(hands.keys.size, 0);
});

test("sliders stay within -1 and 1, relaxing takes all back", () => {
  const hands = new SliderHands();
  hands.move("right", 0, 3); hands.bend("left", 2, -5); hands.drag(-9, 9); hands.lift(2);
  const {left, right} = hands.frame();
  assert.deepEqual([right.position, left.bend[2]], [[-1, -1, 1], -1]);
  hands.relax();
  assert.deepEqual(hands.frame().right.position, [0, 0, 0]);
});

test("a gamepad is told when it changes", () => {
  const pads = new Pads(), pad = (x, on) => ({connected: true, axes: [x, 0], buttons: [{pressed: on}]});
  assert.equal(pads.frame([null]), null);
  assert.deepEqual(pads.frame([null, pad(0.5, false)]), {axes: [0.5, 0], buttons: [false]});
  assert.equal(pads.frame([pad(0.501, false)]), null);
  assert.deepEqual(pads.frame([pad(0.501, true)]).buttons, [true]);
  assert.deepEqual(pads.frame([pad(7, true)]).axes, [1, 0]);
});

test("one message a frame and kind, a heartbeat for what is held, nothing from a page that watches", () => {
  const sources = {contacts: new Contacts(), samples: new PenSamples(), hands: new SliderHands(), pads: new Pads()};
  const sent = [], outbox = new Outbox(sources, (one) => sent.push(one) > 0);
  const now = (time, handsActive = false) => ({time, size: [0.3, 0.2], handsActive, pads: []});
  sources.contacts.put("t0", finger(0.1, 0.1)); sources.contacts.put("t1", finger(0.2, 0.1));
  sources.samples.add(penSample(event({}), picture, false)); sources.samples.add(penSample(event({}), picture, false));
  outbox.flush(now(0), true);
  assert.deepEqual(sent.map((one) => one.kind), ["touch", "pen"]);
  assert.deepEqual([sent[0].t, sent[0].contacts.length, sent[0].size_m, sent[1].pen.length], ["input", 2, [0.3, 0.2], 2]);
  outbox.flush(now(16), true);
  assert.equal(sent.length, 2);
  outbox.flush(now(300), true);
  assert.deepEqual(sent.slice(2).map((one) => one.kind), ["touch", "pen"]);
  sources.hands.move("right", 0, 0.5);
  outbox.flush(now(310), true);
  assert.equal(sent.length, 4);
  outbox.flush(now(320, true), true);
  assert.equal(sent.at(-1).kind, "hands");
  sources.contacts.endAll("up");
  const before = sent.length;
  outbox.flush(now(340), false);
  assert.equal(sent.length, before);
  outbox.flush(now(360), true);
  assert.equal(sent.length, before);
});

test("a bank card tells the size of the picture, and it is remembered", () => {
  const kept = new Map();
  const store = {getItem: (k) => kept.get(k) ?? null, setItem: (k, v) => kept.set(k, v), removeItem: (k) => kept.delete(k)};
  const first = new Calibration(store);
  assert.equal(first.size({width: 800, height: 450}), null, "not measured: nobody knows");
  near(first.metres, 0.0254 / 96);
  first.card(428); // a card of 85.6 mm is 428 pixels wide: 0.2 mm a pixel
  const again = new Calibration(store);
  near(again.pixels, 428);
  const [width, height] = again.size({width: 800, height: 450});
  near(width, 0.16);
  near(height, 0.09);
  again.forget();
  assert.equal(new Calibration(store).size({width: 800, height: 450}), null);
  store.setItem("bunraku.metres", "12");
  assert.equal(new Calibration(store).known, false, "a pixel of twelve metres is not believed");
});
