// The emergency stop. It needs nothing of the rest of the page: its request goes at once, whatever
// else waits for the server, and each press sends another.

const TWICE_MS = 800;
const PATIENCE_MS = 1500;
const TRIES = 3;
const PAUSE_MS = 300;
const form = document.getElementById("estop-form");
const said = document.getElementById("estop-said");
const asked = new URLSearchParams(location.search).get("rig");
const rig = asked || document.body.dataset.rig;
let newest = 0;

// The rig of the address is the one that is stopped, before anything else of the page has come.
form.action = `/api/v1/rigs/${encodeURIComponent(rig)}/estop`;
document.getElementById("estop-rig").textContent = rig;
document.getElementById("estop-rig").hidden = !asked;

function say(text, tone) {
  said.hidden = false;
  said.dataset.tone = tone;
  said.textContent = text;
}

async function ask() {
  const response = await fetch(form.action, { method: "POST", keepalive: true, cache: "no-store" });
  const body = await response.json();
  if (!response.ok) throw new Error(body.detail ?? body.title);
  return body;
}

/** Ask for the emergency stop until it is confirmed; one that is late is not given up. */
async function estop() {
  newest += 1;
  const mine = newest;
  let settled = false;
  const failures = [];
  say(`E-STOP of ${rig} sent, not yet confirmed`, "warn");
  const attempt = async () => {
    try {
      const body = await ask();
      settled = true;
      if (mine !== newest) return;
      const time = new Date().toLocaleTimeString("en-GB", { hour12: false });
      say(`E-STOP of ${rig} confirmed by the actuator at ${time}`
        + `${body.detail ? `: ${body.detail}` : ""}`, "good");
      document.dispatchEvent(new CustomEvent("pincette:estop"));
    } catch (error) {
      failures.push(String(error.message || error));
      await new Promise((go) => setTimeout(go, PAUSE_MS));
    }
  };
  for (let number = 1; number <= TRIES && !settled; number += 1) {
    const trying = attempt();
    // A stream holds a connection that the request may be waiting for.
    if (number === 1) setTimeout(() => settled || announceNeed(), 250);
    await Promise.race([trying, new Promise((go) => setTimeout(go, PATIENCE_MS))]);
    if (!settled && mine === newest && number < TRIES) {
      say(`E-STOP of ${rig} not confirmed yet, sent again (${number + 1} of ${TRIES})`, "warn");
    }
  }
  if (!settled && mine === newest) {
    const why = failures.at(-1) ?? `no answer within ${(TRIES * PATIENCE_MS) / 1000} s`;
    say(`E-STOP OF ${rig} NOT CONFIRMED: ${why}. Press again, and switch the amplifier off by `
      + "hand.", "bad");
  }
}

function announceNeed() {
  document.dispatchEvent(new CustomEvent("pincette:make-way"));
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
