// Saving a take: the stage makes the file, this page shows how far it is and fetches it.

import {attempt, byId, make, toast} from "./dom.js";

const NAMES = {mcap: "bag", bvh: "BVH", glb: "glTF file", mp4: "film"};

/** How far a file is, in words. @param {string} format @param {string} what @param {number} share 0..1 */
export function madeText(format, what, share) {
  const name = NAMES[/** @type {keyof typeof NAMES} */ (format)] ?? format;
  return what ? `Making the ${name}: ${what} ${Math.round(100 * share)} %` : `Making the ${name}…`;
}

/**
 * The list of forms in which the chosen take is saved.
 * @param {import("./connection.js").Connection} connection
 * @param {() => {name: string, figure: string}} chosen the take, an empty name for none
 * @returns {() => void} brings the list up to date with what is chosen
 */
export function saving(connection, chosen) {
  const list = byId("download", HTMLSelectElement), box = byId("making", HTMLElement);
  const text = byId("makingtext", HTMLElement), bar = byId("makingbar", HTMLProgressElement);
  let busy = false;
  const enable = () => { list.disabled = busy || !chosen().name; };
  /** @param {string} format @param {string} what @param {number} share */
  const show = (format, what, share) => {
    text.textContent = madeText(format, what, share);
    if (what) bar.value = share;
    else bar.removeAttribute("value");
  };
  /** @param {string} format @param {{name: string, figure: string}} take */
  const save = async (format, take) => {
    const id = connection.nextCall;
    busy = true;
    enable();
    show(format, "", 0);
    box.hidden = format === "mcap"; // there already
    byId("makingcancel", HTMLButtonElement).onclick = () => attempt(() => connection.call("cancel", {id}));
    try {
      const {url} = await connection.call("take.file", {...take, format}, (what, share) => show(format, what, share));
      const link = make("a", {href: url, download: ""});
      document.body.append(link);
      link.click();
      link.remove();
    } catch (error) {
      const why = error instanceof Error ? error.message : String(error);
      toast(why === "cancelled" ? "Not saved." : `Not saved: ${why}`);
    } finally {
      busy = false;
      box.hidden = true;
      enable();
    }
  };
  list.onchange = () => {
    const format = list.value, take = chosen();
    list.value = "";
    if (format && take.name && !busy) save(format, take);
  };
  return enable;
}
