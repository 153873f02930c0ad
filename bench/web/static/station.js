// The Station page: abort by press-and-hold or by the keyboard, and a new page when another run begins.
// @ts-check

const HOLD_MS = 1000;
const SAID_MS = 2500;

document.body.addEventListener("htmx:sseBeforeMessage", (event) => {
  const message = /** @type {CustomEvent<MessageEvent>} */ (event).detail;
  if (message.type === "other-run") location.reload();
});

// What was said stays until the next command; menus close when a command is sent.
document.body.addEventListener("htmx:afterRequest", () => {
  for (const menu of document.querySelectorAll(".bar details[open]")) menu.removeAttribute("open");
});

/** @param {string} text */
function say(text) {
  const said = document.getElementById("said");
  if (said !== null) said.textContent = text;
}

/** @param {HTMLElement} button */
async function abort(button) {
  button.dataset.state = "sent";
  say(button.dataset.sent ?? "");
  try {
    const answer = await fetch(`/api/v1/runs/${button.dataset.run}/abort`, { method: "POST" });
    const content = await answer.json();
    say(answer.ok ? content.answer : content.detail);
  } catch (problem) {
    say(String(problem));
  }
  button.dataset.state = "";
}

const button = document.getElementById("abort");
const dialog = document.getElementById("abort-dialog");
if (button !== null && dialog instanceof HTMLDialogElement) {
  button.hidden = false;
  /** @type {number | undefined} */
  let timer;
  const begin = () => {
    if (button.dataset.state === "sent") return;
    button.dataset.state = "held";
    timer = setTimeout(() => void abort(button), HOLD_MS);
  };
  const end = () => {
    clearTimeout(timer);
    if (button.dataset.state !== "held") return;
    button.dataset.state = "";
    say(button.dataset.hold ?? "");
    setTimeout(() => {
      if (document.getElementById("said")?.textContent === button.dataset.hold) say("");
    }, SAID_MS);
  };
  button.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    button.setPointerCapture(event.pointerId);
    begin();
  });
  button.addEventListener("pointermove", (event) => {
    const place = button.getBoundingClientRect();
    const inside = event.clientX >= place.left && event.clientX <= place.right && event.clientY >= place.top && event.clientY <= place.bottom;
    if (!inside) end();
  });
  button.addEventListener("pointerup", end);
  button.addEventListener("pointercancel", end);
  button.addEventListener("contextmenu", (event) => event.preventDefault());
  // A click without a pointer is one of the keyboard or of a screen reader: it asks for confirmation.
  button.addEventListener("click", (event) => {
    if (event.detail === 0) dialog.showModal();
  });
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey && event.altKey && event.code === "KeyA" && !dialog.open) {
      event.preventDefault();
      dialog.showModal();
    }
  });
  dialog.addEventListener("click", (event) => {
    const value = event.target instanceof HTMLButtonElement ? event.target.value : "";
    if (value !== "") dialog.close();
    if (value === "yes") void abort(button);
  });
}
