// The emergency stop. It needs nothing of the rest of the page, no key, and no second press: what is
// pressed is kept, over a reload of the page too, and sent again until the actuator confirms it.

const TWICE_MS = 800;
const PATIENCE_MS = 1500;
const GIVEN_UP_MS = 10000;
const PAUSE_MS = 700;
const OTHERWISE = "Stop it another way now: pincette estop on the rig's computer, or the button of the "
  + "amplifier's supply.";
const form = document.getElementById("estop-form");
const said = document.getElementById("estop-said");
const words = document.getElementById("estop-words");
const tries = document.getElementById("estop-tries");
const withdraw = document.getElementById("estop-withdraw");
const asked = new URLSearchParams(location.search).get("rig");
const rig = asked || document.body.dataset.rig;
const KEPT = `pincette:estop:${rig}`;
let pressed = 0;
let sent = 0;
let since = "";
let sending = false;
let wake = () => {};

// The rig of the address is the one that is stopped, before anything else of the page has come.
form.action = `/api/v1/rigs/${encodeURIComponent(rig)}/estop`;
document.getElementById("estop-rig").textContent = rig;
document.getElementById("estop-rig").hidden = !asked;

const clock = () => new Date().toLocaleTimeString("en-GB", { hour12: false });

function say(text, tone) {
  said.hidden = false;
  said.dataset.tone = tone;
  if (words.textContent !== text) words.textContent = text;
  withdraw.hidden = tone === "good";
  tries.textContent = tone === "bad" ? `Sent ${sent} times since ${since}.` : "";
}

/** Remember a press where a reload finds it; a browser may forbid that. */
function keep(value) {
  try {
    if (value) sessionStorage.setItem(KEPT, value);
    else sessionStorage.removeItem(KEPT);
  } catch { /* it is sent all the same, until the page is closed */ }
}

function kept() {
  try {
    return sessionStorage.getItem(KEPT);
  } catch {
    return null;
  }
}

async function ask() {
  let response;
  try {
    const signal = AbortSignal.timeout(GIVEN_UP_MS);
    const how = { method: "POST", keepalive: true, cache: "no-store", signal };
    response = await fetch(form.action, how);
  } catch {
    throw new Error("the supervisor does not answer");
  }
  const body = await response.json().catch(() => null);
  if (!body) throw new Error(`what answers is no supervisor (status ${response.status})`);
  if (!response.ok) {
    const refused = response.status === 503 ? "" : "it is refused: ";
    throw new Error(refused + (body.detail ?? body.title));
  }
  if (!body.acknowledged) throw new Error("the actuator has not acknowledged it");
  return body;
}

function confirmed(body) {
  pressed = 0;
  keep("");
  say(`E-STOP of ${rig} confirmed by the actuator at ${clock()}`
    + `${body.detail ? `: ${body.detail}` : ""}`, "good");
  document.dispatchEvent(new CustomEvent("pincette:estop"));
}

const pause = (length) => new Promise((go) => {
  wake = go;
  setTimeout(go, length);
});

/** Send until what was pressed is confirmed; an answer that is late counts too. */
async function send() {
  if (sending) return;
  sending = true;
  while (pressed) {
    const mine = pressed;
    sent += 1;
    const attempt = ask().then((body) => pressed === mine && confirmed(body), (error) => {
      if (pressed !== mine) return;
      say(`E-STOP OF ${rig} NOT CONFIRMED: ${String(error.message).replace(/\.$/, "")}. It is kept, and `
        + `sent again until the actuator confirms it. ${OTHERWISE}`, "bad");
    });
    // A stream holds a connection that the request may be waiting for.
    const need = setTimeout(() => document.dispatchEvent(new CustomEvent("pincette:make-way")), 250);
    attempt.finally(() => clearTimeout(need));
    const late = await Promise.race([attempt, pause(PATIENCE_MS).then(() => "late")]);
    if (!pressed) break;
    if (late === "late" && pressed === mine && said.dataset.tone !== "bad") {
      say(`E-STOP OF ${rig} NOT CONFIRMED: no answer so far. It is kept, and sent again until the `
        + `actuator confirms it. ${OTHERWISE}`, "bad");
    }
    if (late !== "late") await pause(PAUSE_MS);
  }
  sending = false;
}

/** Each press counts: what was confirmed before it confirms nothing. */
function estop() {
  pressed = performance.now();
  sent = 0;
  since = clock();
  keep(since);
  say(`E-STOP of ${rig} sent, not yet confirmed`, "warn");
  wake();
  send();
}

withdraw.addEventListener("click", () => {
  pressed = 0;
  keep("");
  said.hidden = true;
});
addEventListener("online", () => wake());
if (kept()) {
  pressed = performance.now();
  since = kept();
  say(`E-STOP of ${rig}, pressed at ${since}, is not yet confirmed and is sent again. ${OTHERWISE}`, "bad");
  send();
}

// A press stops at once: what moves under the pointer before it is released cannot undo it. A click
// of detail 0 comes from the keyboard or from an aid for access.
const button = document.getElementById("estop");
button.addEventListener("pointerdown", estop);
button.addEventListener("click", (event) => event.detail === 0 && estop());
form.addEventListener("submit", (event) => event.preventDefault());

let escaped = -Infinity;
document.addEventListener("keydown", (event) => {
  if (event.key !== "Escape") {
    escaped = -Infinity;
    return;
  }
  if (event.repeat) return;
  const now = performance.now();
  if (now - escaped < TWICE_MS) {
    escaped = -Infinity;
    estop();
  } else escaped = now;
}, true);
