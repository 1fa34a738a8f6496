/** The server's answers: JSON, binary arrays, uploads. */

/** An answer that is not what was asked for: the server's own words, with the remedy. */
export class ApiError extends Error {
  /**
   * @param {string} message
   * @param {number} status HTTP status; 0 when the server did not answer
   * @param {string} [needs] the job that has to be done first
   */
  constructor(message, status, needs = "") {
    super(message);
    this.name = "ApiError";
    this.status = status;
    this.needs = needs;
  }
}

const SILENT = "The server does not answer. Is `lacet ui` still running? Start it again, then reload this page.";

async function ask(path, options) {
  let answer;
  try {
    answer = await fetch(path, { credentials: "same-origin", ...options });
  } catch (cause) {
    if (cause.name === "AbortError") throw cause;
    throw new ApiError(SILENT, 0);
  }
  // 202: not yet, as a job has to be done first, or is at work
  if (!answer.ok || answer.status === 202) throw failure(answer.status, await answer.text());
  return answer;
}

function failure(status, text) {
  try {
    const body = JSON.parse(text);
    const said = body.error ?? body.detail;
    const words = typeof said === "string" ? said : JSON.stringify(said ?? body);
    return new ApiError(words, status, body.needs ?? "");
  } catch {
    return new ApiError(text || `the server answered with status ${status}`, status);
  }
}

/** @param {string} path @param {AbortSignal} [signal] @returns {Promise<any>} */
export async function get(path, signal) {
  return (await ask(path, { signal })).json();
}

/** @param {string} path @param {any} body @param {AbortSignal} [signal] @returns {Promise<any>} */
export async function post(path, body, signal) {
  const options = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  return (await ask(path, { ...options, signal })).json();
}

/** @param {string} path @returns {Promise<any>} */
export async function remove(path) {
  return (await ask(path, { method: "DELETE" })).json();
}

/**
 * Arrays of one request.
 * @param {string} path
 * @param {AbortSignal} [signal]
 * @returns {Promise<{meta: Object, arrays: Object<string, Float32Array>}>}
 */
export async function binary(path, signal) {
  return unpack(await (await ask(path, { signal })).arrayBuffer());
}

/**
 * The binary format: length of the head (uint32, little-endian), the head in JSON, float32 arrays one after the other.
 * @param {ArrayBuffer} buffer
 * @returns {{meta: Object, arrays: Object<string, Float32Array>}}
 */
export function unpack(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const meta = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const arrays = {};
  let at = 4 + length;
  for (const { name, n } of meta.arrays) {
    arrays[name] = new Float32Array(buffer, at, n);
    at += 4 * n;
  }
  return { meta, arrays };
}

/**
 * Send a file's bytes as they are.
 * @param {string} path
 * @param {File} file
 * @param {(part: number) => void} [onProgress] part sent, 0 to 1
 * @returns {Promise<any>}
 */
export function upload(path, file, onProgress) {
  return new Promise((resolve, reject) => {
    // fetch says nothing about how much of a body has gone; a log of some gigabytes needs that
    const request = new XMLHttpRequest();
    request.open("PUT", path);
    request.upload.onprogress = (e) => onProgress?.(e.total ? e.loaded / e.total : 0);
    request.onerror = () => reject(new ApiError(SILENT, 0));
    request.onload = () => {
      if (request.status >= 400) reject(failure(request.status, request.responseText));
      else resolve(request.responseText ? JSON.parse(request.responseText) : {});
    };
    request.send(file);
  });
}
