// The choice of a rig, where the supervisor serves several; each rig has an address of its own.

import { get, RIG } from "./api.js";
import { byId, chip, h, show } from "./dom.js";
import { start } from "./rig.js";

const SEVERAL_MS = 3000;
const ALONE_MS = 30000;

const address = (name) => `?rig=${encodeURIComponent(name)}`;

function link(rig) {
  return h("a", { href: address(rig.name), id: `rig-${rig.name}`,
    "aria-current": rig.name === RIG ? "page" : null },
  h("b", {}, rig.name), chip(...start(rig)));
}

/** Show the rigs where there is a choice; say so where the chosen one is none of them. */
function offer(rigs) {
  const known = rigs.some((rig) => rig.name === RIG);
  const several = rigs.length > 1 || !known;
  byId("rigs").hidden = !several;
  byId("estop-rig").hidden = !several;
  show(byId("rigs"), [several, rigs.map((rig) => [rig.name, start(rig)])], () => (several ? [
    known ? null : h("p", { class: "fault", role: "alert" },
      `This supervisor serves no rig ${RIG}; choose one:`),
    ...rigs.map(link)] : []));
  return several;
}

/** Ask for the rigs again and again, more often where there are several. */
export async function followRigs() {
  let several = false;
  try {
    several = offer((await get("/rigs")).rigs);
  } catch {
    // The bar says that the supervisor does not answer.
  }
  setTimeout(followRigs, several && !document.hidden ? SEVERAL_MS : ALONE_MS);
}
