// The emergency stop. The server writes this script into the page itself, so that it needs no other
// file, and it uses only what browsers of 2018 have. It sends a press again, also after a reload of
// the page, until the actuator confirms it.
(function () {
  "use strict";
  var TWICE_MS = 800;
  var PATIENCE_MS = 1500;
  var GIVEN_UP_MS = 10000;
  var PAUSE_MS = 700;
  var OTHER_POOL_MS = 250;
  var FOLLOWS_MS = 5000;
  var CHECK_AGAIN_MS = 5000;
  var AGAIN_MS = 500;
  var START_MS = 10000;
  var OTHERWISE = "Stop it another way now: pincette estop on the rig's computer, or the button of the "
    + "amplifier's supply.";
  var root = document.documentElement;
  var rig = root.getAttribute("data-rig"); // the supervisor has read it in the address of the page
  var supervisor = root.getAttribute("data-supervisor");
  var KEPT = "pincette:estop:" + rig;
  var pressed = 0; // number of the press that is not yet confirmed; 0 for none
  var presses = 0;
  var sent = 0;
  var since = "";
  var timer = 0;

  // The page is at the root of its address, with or without a slash at the end.
  var path = location.pathname;
  var folder = path.replace(/\/[^/]*\.html?$/, "/").replace(/([^/])$/, "$1/");
  if (folder !== path) {
    var base = document.createElement("base");
    base.href = folder;
    document.head.insertBefore(base, document.head.firstChild);
  }
  var RIG_PATH = folder + "api/v1/rigs/" + encodeURIComponent(rig);

  function byId(id) { return document.getElementById(id); }
  function now() { return window.performance && performance.now ? performance.now() : Date.now(); }
  function clock() { return new Date().toTimeString().slice(0, 8); }

  function announce(name) {
    try {
      document.dispatchEvent(new CustomEvent(name));
    } catch (error) { /* the stop itself needs no listener */ }
  }

  var said = null;
  function say(text, tone) {
    var place = byId("estop-said");
    said = [text, tone];
    if (!place) return; // the page is still being read
    place.hidden = false;
    place.setAttribute("data-tone", tone);
    if (byId("estop-words").textContent !== text) byId("estop-words").textContent = text;
    byId("estop-withdraw").hidden = tone === "good";
    byId("estop-tries").textContent = tone === "bad" ? "Sent " + sent + "× since " + since + "." : "";
  }

  /** Store the time of a press for a reload of the page, where the browser permits it. */
  function keep(value) {
    try {
      if (value) sessionStorage.setItem(KEPT, value);
      else sessionStorage.removeItem(KEPT);
    } catch (error) { /* without storage the press lasts as long as the page */ }
  }

  function kept() {
    try {
      return sessionStorage.getItem(KEPT);
    } catch (error) {
      return null;
    }
  }

  // Requests under way. One that is sent late, after a reset by a person, would stop the rig again.
  var underWay = [];
  function callBack() {
    underWay.splice(0).forEach(function (each) { each.abort(); });
  }

  function viaXhr(address, done) {
    var request = new XMLHttpRequest();
    request.open("POST", address);
    request.timeout = GIVEN_UP_MS;
    request.onload = function () {
      done("", request.status, request.responseText);
    };
    request.onerror = request.ontimeout = function () { done("the supervisor does not answer"); };
    request.send();
    return request;
  }

  function viaFetch(address, credentials, done) {
    var control = window.AbortController ? new AbortController() : { abort: function () {} };
    fetch(address, { method: "POST", credentials: credentials, cache: "no-store", signal: control.signal })
      .then(function (response) {
        return response.text().then(function (text) {
          done("", response.status, text);
        });
      }).then(null, function () { done("the supervisor does not answer"); });
    return control;
  }

  /** Send a request without a body; null where the browser has no function that can. */
  function post(address, done) {
    try {
      return viaXhr(address, done);
    } catch (error) { /* try the other function */ }
    try {
      return viaFetch(address, "same-origin", done);
    } catch (error) {
      return null;
    }
  }

  /** Return the JSON object of an answer, or null where another program has answered. */
  function objectOf(text) {
    try {
      var body = JSON.parse(text);
      return body && typeof body === "object" ? body : null;
    } catch (error) {
      return null;
    }
  }

  function isOurs(body) {
    return body.rig === rig && (!supervisor || body.supervisor === supervisor);
  }

  /** Return why an answer confirms nothing, or an empty text where it does. */
  function fault(status, body) {
    if (!body) return "what answers is not the supervisor of this rig (status " + status + ")";
    if (status < 200 || status > 299) {
      return (status === 503 ? "" : "it is refused: ") + (body.detail || body.title || "status " + status);
    }
    if (!isOurs(body)) return "what answers is not the supervisor of this rig: reload the page";
    return body.acknowledged === true ? "" : "the actuator has not acknowledged it";
  }

  function unconfirmed(why) {
    say("E-STOP OF " + rig + " NOT CONFIRMED: " + why + "; it is kept, and sent again until the "
      + "actuator confirms it. " + OTHERWISE, "bad");
  }

  function end() {
    pressed = 0;
    clearTimeout(timer);
    callBack();
    keep("");
  }

  function confirmed(body) {
    end();
    say("E-STOP of " + rig + " confirmed by the actuator at " + clock()
      + (body.detail ? ": " + body.detail : ""), "good");
    announce("pincette:estop");
  }

  /** Without a function that reads answers: send it without reading one, then as a form, whose answer is shown. */
  function blindly() {
    unconfirmed("this browser cannot read the answer");
    try {
      navigator.sendBeacon(RIG_PATH + "/estop");
    } catch (error) { /* the form remains */ }
    end();
    HTMLFormElement.prototype.submit.call(byId("estop-form"));
  }

  /** Send the press, and again until it is confirmed; an answer that is late counts too. */
  function send() {
    var mine = pressed;
    var answered = false;
    if (!mine) return;
    clearTimeout(timer);
    timer = setTimeout(function () {
      if (pressed === mine && said[1] !== "bad") unconfirmed("no answer so far");
      send();
    }, PATIENCE_MS);
    sent += 1;
    function done(failure, status, text) {
      if (pressed !== mine) return;
      answered = true;
      var body = failure ? null : objectOf(text);
      var why = failure || fault(status, body);
      if (!why) {
        confirmed(body);
        return;
      }
      unconfirmed(why);
      clearTimeout(timer);
      timer = setTimeout(send, PAUSE_MS);
    }
    var request = post(RIG_PATH + "/estop", done);
    if (!request) {
      blindly();
      return;
    }
    underWay.push(request);
    // Other windows may hold all connections of this browser. It has others for requests without
    // credentials, and the stop needs none.
    setTimeout(function () {
      if (answered || pressed !== mine) return;
      announce("pincette:make-way");
      try {
        underWay.push(viaFetch(RIG_PATH + "/estop", "omit", done));
      } catch (error) { /* the first request is still under way */ }
    }, OTHER_POOL_MS);
  }

  /** Start a stop. An earlier confirmation does not count for it. */
  function estop() {
    presses += 1;
    pressed = presses;
    sent = 0;
    since = clock();
    keep(since);
    say("E-STOP of " + rig + " sent, not yet confirmed", "warn");
    send();
  }

  function onButton(event) {
    return event.target && event.target.closest && event.target.closest("#estop");
  }

  // A press acts at once, whatever moves under the pointer before it is released. A click without a
  // press before it comes from the keyboard or from assistive technology.
  var DOWN = window.PointerEvent ? ["pointerdown"] : ["touchstart", "mousedown"];
  var downAt = -Infinity;
  function down(event) {
    if (!onButton(event)) return;
    var follows = event.type === "mousedown" && now() - downAt < TWICE_MS; // a touch makes one, too
    downAt = now();
    if (!follows) estop();
  }
  DOWN.forEach(function (name) { window.addEventListener(name, down, true); });
  window.addEventListener("click", function (event) {
    if (event.target && event.target.id === "estop-withdraw") {
      end();
      byId("estop-said").hidden = true;
    }
    if (onButton(event) && (event.detail === 0 || now() - downAt > FOLLOWS_MS)) estop();
  }, true);
  window.addEventListener("submit", function (event) {
    if (event.target && event.target.id === "estop-form") {
      event.preventDefault();
      if (!pressed && now() - downAt > FOLLOWS_MS) estop();
    }
  }, true);

  // Escape twice. A press counts only if it is plain, new, and not meant for an input method (229).
  var escaped = -Infinity;
  function isPlain(event) {
    return (event.key === "Escape" || event.key === "Esc") && !event.repeat && !event.isComposing
      && event.keyCode !== 229 && !event.ctrlKey && !event.altKey && !event.metaKey && !event.shiftKey
      && !(event.getModifierState && event.getModifierState("AltGraph"));
  }
  window.addEventListener("keydown", function (event) {
    if (!isPlain(event)) {
      if (!(event.repeat && event.key === "Escape")) escaped = -Infinity;
      return;
    }
    if (now() - escaped < TWICE_MS) {
      escaped = -Infinity;
      estop();
    } else escaped = now();
  }, true);

  // Ask the supervisor whether it would accept a stop of this page, before one is needed.
  var checking = 0;
  function warn(text) {
    var place = byId("stop-check");
    place.hidden = text === "";
    if (place.textContent !== text) place.textContent = text;
  }
  function lack(failure, status, body) {
    if (failure) return "It is not known whether a stop would arrive: " + failure + ". " + OTHERWISE;
    var start = "A STOP FROM THIS PAGE WOULD NOT REACH " + rig + ": ";
    if (!body || (status < 300 && !(body.stop && isOurs(body)))) {
      return start + "what answers at " + location.protocol + "//" + location.host + RIG_PATH
        + " is another program, or the supervisor was changed. Reload the page; let the reverse proxy"
        + " pass on everything below " + folder + " to the supervisor. " + OTHERWISE;
    }
    if (status > 299) return start + (body.detail || body.title || "status " + status) + ". " + OTHERWISE;
    if (!body.stop.accepted) {
      return start + body.stop.detail + ". Remedy: " + body.stop.remedy + " " + OTHERWISE;
    }
    var order = body.order || {};
    if (order.accepted === false && order.code !== "no-key" && order.code !== "scope-too-small") {
      return "A stop would arrive, but the supervisor refuses all else from this page: " + order.detail
        + ". Remedy: " + order.remedy;
    }
    return "";
  }
  function check() {
    clearTimeout(checking);
    var able = post(RIG_PATH + "/page-check", function (failure, status, text) {
      var found = lack(failure, status, failure ? null : objectOf(text));
      warn(found);
      clearTimeout(checking);
      if (found) checking = setTimeout(check, CHECK_AGAIN_MS);
    });
    if (!able) warn("This browser cannot read the answer to a stop: its answer replaces the page.");
  }

  // Say in red when the rest of the page does not work; the stop does not need it.
  var LATE = "it has not started";
  var broken = "";
  function breakDown(why) {
    broken = broken || why;
    root.setAttribute("data-broken", "");
    if (!byId("broken")) return;
    byId("broken").hidden = false;
    byId("broken").textContent = "This page does not work (" + broken + "): what it shows may be old or "
      + "missing. E-STOP works. Reload the page, or use a newer browser.";
    byId("connection").textContent = "page does not work";
    byId("connection").setAttribute("data-tone", "bad");
  }
  window.addEventListener("error", function (event) {
    var element = event.target;
    if (element && element.tagName === "SCRIPT" && element.src.indexOf(location.origin) === 0) {
      breakDown("a script could not be loaded");
    }
    if (!event.error) return; // not thrown by a script, as the notice of a ResizeObserver
    if ((event.filename || "").indexOf(location.origin) === 0) breakDown(event.message);
  }, true);
  window.addEventListener("unhandledrejection", function (event) {
    // A refused request has a status: it is shown where it was made.
    var reason = event.reason || {};
    if (reason.status === undefined) breakDown(String(reason.message || reason));
  });
  document.addEventListener("pincette:broken", function (event) { breakDown(String(event.detail)); });

  /** A page that starts late, over a slow line, takes the notice back. */
  function watchStart() {
    var started = root.getAttribute("data-page") === "live";
    if (started && broken === LATE) {
      broken = "";
      root.removeAttribute("data-broken");
      byId("broken").hidden = true;
    }
    if (started) return;
    breakDown(LATE);
    setTimeout(watchStart, AGAIN_MS);
  }

  function begin() {
    byId("estop-form").action = RIG_PATH + "/estop";
    byId("estop-rig").textContent = rig;
    byId("estop-rig").hidden = location.search === "";
    if (broken) breakDown(broken);
    setTimeout(watchStart, START_MS);
    if (said) say(said[0], said[1]);
    else if (kept()) {
      since = kept();
      presses += 1;
      pressed = presses;
      say("E-STOP of " + rig + ", pressed at " + since + ", is not yet confirmed and is sent again. "
        + OTHERWISE, "bad");
      send();
    }
    check();
  }
  // The event DOMContentLoaded waits for the other scripts, which may never come.
  function whenParsed() {
    if (byId("latch")) begin();
    else setTimeout(whenParsed, 10);
  }
  whenParsed();
  window.addEventListener("online", function () {
    send();
    check();
  });
  document.addEventListener("pincette:answers", check);
  window.addEventListener("pagehide", function () {
    try {
      if (pressed) navigator.sendBeacon(RIG_PATH + "/estop");
    } catch (error) { /* the press is kept for a reload */ }
  });
}());
