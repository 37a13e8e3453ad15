// The parameters of the running nodes, with their documentation, as controls.

import {attempt, byId, make} from "./dom.js";

/**
 * @typedef {{value: any, type: string, doc: string, low: number | null, high: number | null, choices: string[] | null,
 *   settable: boolean}} Parameter
 */

/**
 * What kind of control fits a parameter.
 * @param {Parameter} one @returns {"switch" | "choice" | "slider" | "number" | "text"}
 */
export function controlOf(one) {
  if (!one.settable) return "text";
  if (one.choices) return "choice";
  if (typeof one.value === "boolean") return "switch";
  if (typeof one.value === "number") return one.low !== null && one.high !== null ? "slider" : "number";
  return "text";
}

/**
 * The step of a number's control: fine enough for its range, whole for whole numbers.
 * @param {Parameter} one
 */
export function stepOf(one) {
  if (one.type === "int") return 1;
  if (one.low === null || one.high === null) return "any";
  return 10 ** Math.floor(Math.log10((one.high - one.low) / 200 || 1));
}

/** @param {unknown} value */
const text = (value) => (typeof value === "string" ? value || "–" : JSON.stringify(value));

/**
 * @param {Parameter} one @param {string} name @param {(value: any) => void} set
 */
function control(one, name, set) {
  const kind = controlOf(one);
  if (kind === "text") return make("span", {className: "fixed", textContent: text(one.value)});
  if (kind === "choice") {
    const select = make("select", {ariaLabel: name});
    for (const choice of one.choices ?? []) select.append(make("option", {textContent: choice, selected: choice === one.value}));
    select.onchange = () => set(select.value);
    return select;
  }
  if (kind === "switch") {
    const box = make("input", {type: "checkbox", checked: one.value, ariaLabel: name});
    box.onchange = () => set(box.checked);
    return box;
  }
  const input = make("input", {type: kind === "slider" ? "range" : "number", ariaLabel: name});
  if (one.low !== null) input.min = String(one.low);
  if (one.high !== null) input.max = String(one.high);
  input.step = String(stepOf(one));
  input.value = String(one.value);
  input.onchange = () => {
    if (input.value !== "" && input.checkValidity()) set(Number(input.value));
  };
  if (kind === "number") return input;
  const shown = make("output", {textContent: String(one.value)});
  input.oninput = () => { shown.textContent = input.value; };
  return make("span", {className: "row"}, input, shown);
}

/**
 * Show the nodes' parameters.
 * @param {import("./connection.js").Connection} connection
 */
export async function showParams(connection) {
  const box = byId("nodes", HTMLElement);
  const opened = new Set([...box.querySelectorAll("details[open]")].map((one) => one.id));
  const {nodes} = await connection.call("nodes");
  box.replaceChildren(...nodes.map((/** @type {{node: string, params: Record<string, Parameter>}} */ {node, params}) => {
    const rows = Object.entries(params).map(([name, one]) => {
      const set = (/** @type {any} */ value) => attempt(() => connection.call("param", {node, name, value}));
      return make("div", {className: "parameter"},
        make("label", {className: "row"}, make("span", {textContent: name.replaceAll("_", " ")}), control(one, `${node} ${name}`, set)),
        make("small", {textContent: one.doc}));
    });
    const id = `node ${node}`;
    return make("details", {id, open: opened.has(id)}, make("summary", {textContent: node}), ...rows);
  }));
  if (!nodes.length) box.textContent = "No node tells its parameters.";
}
