// The user of the page, and what the user may do. A key is typed in once; from then on a cookie that
// no script can read replaces it, so that streams and the e-stop need nothing more.

import { BASE, heard, timedFetch } from "./api.js";
import { byId, setText } from "./dom.js";

const SCOPES = ["observe", "propose", "operate", "admin"];
const MAY = {
  observe: "see everything, and stop at once",
  propose: "plan jobs, and propose them for approval",
  operate: "run and act on jobs, store recipes and reset",
  admin: "do everything",
};
const AGAIN_MS = 2000;

let session = { keys: false, name: null, scope: null };
let waiting = [];

/** Return whether requests that need a scope are permitted. */
export const may = (needed) => session.scope !== null
  && SCOPES.indexOf(session.scope) >= SCOPES.indexOf(needed);

async function ask(method, headers = {}, body = undefined) {
  const { response, text } = await timedFetch(`${BASE}/session`, { method, headers, body });
  const said = JSON.parse(text);
  if (!response.ok) throw new Error(said.detail ?? said.title);
  return said;
}

const reason = (needed) => `needs scope ${needed}; ${session.name} has ${session.scope}`;

/** Bar what the scope does not hold, and say why at each control. */
function bar() {
  for (const each of document.querySelectorAll("[data-needs]")) {
    const barred = session.scope !== null && !may(each.dataset.needs);
    if (barred && !each.disabled) each.disabled = true;
    if (barred && each.title !== reason(each.dataset.needs)) {
      each.title = reason(each.dataset.needs);
      each.setAttribute("aria-describedby", "may");
      each.dataset.barred = "";
    } else if (!barred && "barred" in each.dataset) {
      each.disabled = false;
      each.removeAttribute("title");
      each.removeAttribute("aria-describedby");
      delete each.dataset.barred;
    }
  }
}

const watcher = new MutationObserver(bar);

function take(found) {
  session = found;
  const known = session.keys && session.name !== null;
  byId("who").hidden = !known;
  byId("sign-in").hidden = session.scope !== null;
  byId("may").hidden = !known || may("admin");
  if (known) {
    setText(byId("who-name"), `${session.name} · ${session.scope}`);
    setText(byId("may"), `${session.name} has scope ${session.scope}: it may `
      + `${MAY[session.scope]}. What needs more is switched off.`);
  }
  watcher.disconnect();
  if (known && !may("admin")) {
    const attributeFilter = ["disabled"];
    watcher.observe(document.body, { childList: true, subtree: true, attributes: true, attributeFilter });
  }
  bar();
  if (session.scope === null) {
    heard.trouble = "it requires a key";
    return;
  }
  for (const go of waiting) go();
  waiting = [];
}

/** Return once the user of the page has at least the scope to read. */
export async function admitted() {
  while (session.scope === null) {
    const entered = new Promise((go) => waiting.push(go));
    try {
      take(await ask("GET"));
      await entered;
    } catch (error) {
      if (typeof fetch !== "function") throw error;
      await new Promise((go) => setTimeout(go, AGAIN_MS));
    }
  }
}

async function signIn(event) {
  event.preventDefault();
  const key = byId("sign-in-key");
  setText(byId("sign-in-said"), "");
  try {
    const user = byId("sign-in-user").value.trim();
    if (user) {
      await ask("POST", { "Content-Type": "application/json" },
        JSON.stringify({ user, password: key.value }));
    } else await ask("POST", { Authorization: `Bearer ${key.value.trim()}` });
    key.value = "";
    take(await ask("GET"));
  } catch (error) {
    setText(byId("sign-in-said"), String(error.message || error));
    key.focus();
  }
}

async function signOut() {
  await ask("DELETE").catch(() => {});
  location.reload();
}

byId("sign-in-form").addEventListener("submit", signIn);
byId("sign-out").addEventListener("click", signOut);
document.addEventListener("pincette:signed-out", () => {
  if (session.scope !== null) take({ keys: true, name: null, scope: null });
});
