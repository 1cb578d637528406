// The operator's side of the console: says what is held, twenty times a second while anything is,
// and what is pressed. What the robot makes of it is decided there.
"use strict";

const PERIOD = 50; // between two words while something is held [ms]
const IDLE = 500; // and while nothing is: they tell how long words take [ms]
const SILENT = 1500; // without a word from the console after which it counts as lost [ms]
const LOOK = 4 * PERIOD; // that a look at its silence counts at most: a browser may be stopped, too [ms]
const HOLD = 500; // for which CUT must be held [ms]
const TURNS = 5; // in as many turns: what happens to the pointer on a busy page is heard between them
const UNSENT = 2000; // that may wait in the browser; more would arrive too late [bytes]

const find = (id) => document.getElementById(id);
const view = find("view");
const rows = { mode: find("modes"), gait: find("gaits"), action: find("actions") };
const held = { move: null, turn: null, keys: new Set(), pad: false };
let meaning = { motion_keys: {}, action_keys: {} };
let socket, beat = 0, said = 0, wasHeld = true;
let heard = false, silence = 0, looked = 0; // whether the console has spoken; since its last word, at the last look [ms]
let robot = {}, told = {}; // the last words on the robot, and on this operator
let unsent = null; // refusal of what could not be sent, until something can

// The connection ------------------------------------------------------------------------------
function connect() {
  socket = new WebSocket(location.href.replace(/^http/, "ws").replace(/\/[^/]*$/, "/operator"));
  socket.onmessage = (event) => take(JSON.parse(event.data));
  socket.onopen = () => { wasHeld = true; };
  socket.onclose = (event) => {
    beat = 0;
    heard = false;
    lose(event.reason || "no connection to the robot");
    setTimeout(connect, 1000);
  };
}

function send(word) {
  if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(word));
  else lose("no connection to the robot");
}

function lose(why) {
  document.body.classList.add("lost");
  write("state", "no connection");
  write("next", why);
  write("mode", "");
  write("link", "");
}

function ask(what, value) {
  const isSent = socket.readyState === WebSocket.OPEN;
  const at = new Date().toTimeString().slice(0, 8);
  unsent = isSent ? null : { refused: true, at, said: `${value}: not sent, no connection to the robot` };
  send({ type: "ask", what, value, beat });
  tell();
}

function write(place, text) {
  if (find(place).textContent !== text) find(place).textContent = text;
}

// What comes ----------------------------------------------------------------------------------
function take(message) {
  if (message.motion_keys) {
    meaning = message;
    return;
  }
  beat = message.beat;
  heard = true;
  silence = 0;
  document.body.classList.remove("lost");
  told = message;
  const drives = { you: "you drive", another: "somebody else drives" }[told.driver] || "nobody drives";
  write("link", told.delay === null ? drives : `${drives} · ${Math.round(1000 * told.delay)} ms`);
  if (message.robot.modes) show(message.robot);
  tell();
}

// The outcome of the last request of this operator; and why what is held moves nothing.
function tell() {
  const outcome = unsent || told;
  write("said", outcome.said ? `${outcome.at} ${outcome.said}`.trim() : "");
  find("said").classList.toggle("refused", Boolean(outcome.refused));
  find("goto").setAttribute("aria-pressed", Boolean(told.picks));
  const isHeld = (held.pad && told.holds) || held.move || held.turn || held.keys.size;
  const isLost = document.body.classList.contains("lost");
  const why = isHeld ? (isLost ? "no connection to the robot" : robot.obstacle || told.obstacle) : "";
  write("obstacle", why);
  if (!isLost) write("next", why ? `this moves nothing: ${why}` : robot.next || "");
}

function show(state) {
  robot = state;
  document.body.dataset.kind = robot.kind;
  write("state", robot.title);
  write("mode", [robot.mode.replaceAll("_", " "), robot.why].filter(Boolean).join(": "));
  const key = (name) => Object.keys(meaning.action_keys).find((k) => meaning.action_keys[k] === name);
  fill("action", robot.actions.map((action) => {
    const hint = key(action.name) ? `key ${key(action.name).replace(" ", "space")}` : "";
    return { ...action, meaning: [action.meaning, hint].filter(Boolean).join("; ") };
  }));
  fill("mode", robot.modes.filter((mode) => mode.name !== "emergency_stop"), robot.mode);
  fill("gait", robot.gaits.map((name) => ({ name, possible: true })), robot.gait);
  find("fans").hidden = !robot.fans;
  for (const part of ["drives", "fans"]) find(part).lastElementChild.textContent = robot[part] || "";
}

// A button for each of what there is, changed only where something has changed.
function fill(what, each, present) {
  const row = rows[what];
  const names = each.map(({ name }) => name).join();
  if (row.dataset.names !== names) {
    row.dataset.names = names;
    row.querySelectorAll("button").forEach((button) => button.remove());
    for (const { name, meaning: title } of each) {
      const button = document.createElement("button");
      Object.assign(button, { textContent: name.replaceAll("_", " "), title: title || "" });
      Object.assign(button.dataset, { what, value: name });
      row.append(button);
    }
  }
  row.querySelectorAll("button").forEach((button, index) => {
    const { name, possible, meaning: title } = each[index];
    button.disabled = !possible;
    button.title = title || "";
    if (what === "action") button.classList.toggle("next", name === robot.press);
    else button.setAttribute("aria-pressed", name === present);
  });
}

document.addEventListener("click", (event) => {
  const { what, value } = event.target.dataset;
  const isDone = event.target === stop && event.detail > 0; // by the press, before the click
  if (what && !isDone) ask(what, value);
});

// The two that stop ---------------------------------------------------------------------------
const stop = find("stop"), cut = find("cut");
let holding = 0, turns = 0, since = 0;

stop.addEventListener("pointerdown", () => ask(stop.dataset.what, stop.dataset.value));

function holdCut() {
  if (holding) return;
  turns = 0;
  since = performance.now();
  cut.classList.remove("sent");
  cut.classList.add("holding");
  holding = setInterval(() => {
    turns += 1;
    if (turns < TURNS || performance.now() - since < HOLD) return;
    releaseCut();
    cut.classList.add("sent");
    setTimeout(() => cut.classList.remove("sent"), 1000);
    ask("action", "cut");
  }, HOLD / TURNS);
}

function releaseCut() {
  clearInterval(holding);
  holding = 0;
  cut.classList.remove("holding");
}

cut.addEventListener("pointerdown", (event) => event.button === 0 && holdCut());
for (const end of ["pointerup", "pointerleave", "pointercancel", "blur", "keyup"]) cut.addEventListener(end, releaseCut);
cut.addEventListener("pointermove", ({ clientX, clientY }) => { // a finger that slides off stays its target
  if (document.elementFromPoint(clientX, clientY) !== cut) releaseCut();
});
cut.addEventListener("keydown", (event) => {
  if (["Enter", " "].includes(event.key) && !event.repeat) holdCut();
});
document.getElementById("end").addEventListener("contextmenu", (event) => event.preventDefault());

// What is held --------------------------------------------------------------------------------
for (const id of ["move", "turn"]) {
  const stick = find(id);
  const put = (x, y) => { stick.firstElementChild.style.transform = `translate(${x}px, ${y}px)`; };
  const drag = (event) => {
    if (!stick.hasPointerCapture(event.pointerId)) return;
    const box = stick.getBoundingClientRect();
    const reach = box.width / 2;
    let x = (event.clientX - box.left) / reach - 1;
    let y = id === "turn" ? 0 : (event.clientY - box.top) / reach - 1;
    const size = Math.max(1, Math.hypot(x, y));
    [x, y] = [x / size, y / size];
    held[id] = { ahead: -y, left: -x };
    stick.classList.add("held");
    put(x * reach, y * reach);
    tell();
  };
  const drop = () => {
    held[id] = null;
    stick.classList.remove("held");
    put(0, 0);
    tell();
  };
  stick.addEventListener("pointerdown", (event) => {
    stick.setPointerCapture(event.pointerId);
    drag(event);
  });
  stick.addEventListener("pointermove", drag);
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) stick.addEventListener(end, drop);
  stick.drop = drop;
}

function onKey(event) {
  const key = event.key.toLowerCase();
  const typing = event.target.closest?.("input:not([type=checkbox], [type=range]), textarea, select, [contenteditable]");
  if (event.type === "keyup" && held.keys.delete(key)) tell();
  if (typing || event.ctrlKey || event.altKey || event.metaKey) return;
  const action = meaning.action_keys[key];
  const isStop = action === find("stop").dataset.value;
  if (!(isStop || (find("keys").checked && (action || meaning.motion_keys[key])))) return;
  event.preventDefault(); // neither a button nor viser's camera is meant
  event.stopPropagation();
  if (event.type !== "keydown" || event.repeat) return;
  if (action) return ask("action", action);
  held.keys.add(key);
  tell();
}

function release() {
  held.keys.clear();
  find("move").drop();
  find("turn").drop();
  releaseCut();
}

// The picture has a window of its own: keys go to one of the two. Where a click there leads viser says;
// that it is this operator's, and when it was, is said here.
function listen(target) {
  target.addEventListener("keydown", onKey, true);
  target.addEventListener("keyup", onKey, true);
  target.addEventListener("blur", () => setTimeout(() => document.hasFocus() || release()));
}

listen(window);
view.addEventListener("load", () => {
  listen(view.contentWindow);
  view.contentWindow.addEventListener("pointerup", () => told.picks && ask("navigation", "click"), true);
});
document.addEventListener("visibilitychange", release);
find("keys").addEventListener("change", release);
find("speed").addEventListener("input", (event) => { event.target.nextElementSibling.value = `${event.target.value} %`; });

// A gamepad in the order and with the signs of sensor_msgs/Joy: left and ahead are positive.
function gamepad() {
  if (!navigator.getGamepads) { // browsers give them to pages of this machine and of https alone
    find("pad").textContent = "no gamepad over http";
    return null;
  }
  const pad = document.hasFocus() ? [...navigator.getGamepads()].find((each) => each?.connected) : null;
  find("pad").textContent = pad ? pad.id : "no gamepad: press one of its buttons";
  if (!pad) return null;
  const [x = 0, y = 0, x2 = 0, y2 = 0] = pad.axes.map((value) => Math.max(-1, Math.min(1, -value)));
  const buttons = pad.buttons.slice(0, 32).map(({ pressed }) => pressed);
  return { axes: [x, y, 0, x2, y2, 0], buttons };
}

setInterval(() => {
  silence += Math.min(performance.now() - looked, LOOK);
  looked = performance.now();
  if (heard && silence > SILENT) lose("the robot does not answer");
  const { move, turn, keys } = held;
  const pad = gamepad();
  held.pad = Boolean(pad);
  const isHeld = Boolean(move || turn || keys.size || pad);
  const isToldAnew = wasHeld || (told.obstacle && told.driver !== "another" && performance.now() - said > 2 * PERIOD);
  if (!isHeld && !isToldAnew && performance.now() - said < IDLE) return;
  if (!beat || socket.readyState !== WebSocket.OPEN || socket.bufferedAmount > UNSENT) return;
  said = performance.now();
  wasHeld = isHeld;
  const stick = move || turn ? [move?.ahead || 0, move?.left || 0, turn?.left || 0] : null;
  send({ type: "hold", beat, stick, keys: [...keys], pad, speed: find("speed").value / 100 });
}, PERIOD);

connect();
