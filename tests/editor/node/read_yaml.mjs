// Reads the texts of a JSON list on stdin as YAML 1.2, and prints what each says, and where.
import { readFileSync } from 'node:fs'
import { LineCounter, isAlias, isMap, isScalar, isSeq, parseDocument } from 'yaml'

function read(text) {
  const lines = new LineCounter()
  const document = parseDocument(text, { version: '1.2', schema: 'core', lineCounter: lines, logLevel: 'silent' })
  if (document.errors.length > 0) return { error: document.errors[0].code }
  const place = (node) => {
    if (!node?.range) return null
    const at = lines.linePos(node.range[0])
    return [at.line, at.col]
  }
  const walk = (node) => {
    if (node === null) return { scalar: null }
    if (isAlias(node)) return { alias: true }
    if (isMap(node)) {
      const pairs = node.items.map(({ key, value }) => [key?.source ?? '', place(key), walk(value)])
      return { map: pairs, at: place(node), anchored: Boolean(node.anchor) }
    }
    if (isSeq(node)) return { list: node.items.map(walk), at: place(node), anchored: Boolean(node.anchor) }
    const { value } = node
    const number = typeof value === 'number' || typeof value === 'bigint'
    return { [number ? 'number' : 'scalar']: number ? String(value) : value, at: place(node), anchored: Boolean(node.anchor) }
  }
  return { root: walk(document.contents) }
}

const texts = JSON.parse(readFileSync(0, 'utf8'))
process.stdout.write(JSON.stringify(texts.map(read)))
