//! Names of the functions of the running program, from its own file's table of symbols.

use std::collections::BTreeMap;
use std::fs;
use std::io;

/// See the module's text.
pub struct Symbols {
    /// Where the program was loaded; its file's addresses count from there.
    base: u64,
    /// End and name by start, in the file's addresses.
    functions: BTreeMap<u64, (u64, String)>,
    /// Start, end and file name of what else is loaded.
    libraries: Vec<(u64, u64, String)>,
}

/// A number of `N` bytes at `at`; 0 beyond the end.
fn number<const N: usize>(bytes: &[u8], at: u64) -> u64 {
    let at = at as usize;
    let mut wide = [0; 8];
    wide[..N].copy_from_slice(bytes.get(at..at + N).unwrap_or(&[0; N]));
    u64::from_le_bytes(wide)
}

/// Functions of a 64-bit little-endian ELF file: start, size and mangled name.
fn functions(elf: &[u8]) -> Vec<(u64, u64, String)> {
    const SYMBOLS: u64 = 2;
    const FUNCTION: u64 = 2;
    let section = |index: u64| number::<8>(elf, 0x28) + index * number::<2>(elf, 0x3a);
    let place = |section: u64| (number::<8>(elf, section + 0x18), number::<8>(elf, section + 0x20));
    let Some(table) = (0..number::<2>(elf, 0x3c)).map(section).find(|&at| number::<4>(elf, at + 4) == SYMBOLS) else {
        return Vec::new();
    };
    let (first, bytes) = place(table);
    let (names, _) = place(section(number::<4>(elf, table + 0x28)));
    let name = |at: u64| {
        let text = elf.get((names + at) as usize..).unwrap_or_default();
        let end = text.iter().position(|&byte| byte == 0).unwrap_or(0);
        String::from_utf8_lossy(&text[..end]).into_owned()
    };
    let symbols = (first..first + bytes).step_by(24).filter(|&at| number::<1>(elf, at + 4) & 15 == FUNCTION);
    symbols.map(|at| (number::<8>(elf, at + 8), number::<8>(elf, at + 16), name(number::<4>(elf, at)))).collect()
}

impl Symbols {
    /// Those of the running program.
    ///
    /// # Errors
    /// When its file, or the list of what is loaded, cannot be read.
    pub fn of_this_program() -> io::Result<Self> {
        let program = fs::read_link("/proc/self/exe")?;
        let own = program.to_string_lossy();
        let (mut base, mut libraries) = (None, Vec::new());
        for line in fs::read_to_string("/proc/self/maps")?.lines() {
            let (Some((range, _)), Some(from)) = (line.split_once(' '), line.find('/')) else { continue };
            let mut ends = range.split('-').map(|end| u64::from_str_radix(end, 16).unwrap_or(0));
            let (start, end) = (ends.next().unwrap_or(0), ends.next().unwrap_or(0));
            if line[from..] == *own {
                base.get_or_insert(start);
            } else {
                let name = line[from..].rsplit('/').next().unwrap_or_default();
                libraries.push((start, end, name.to_owned()));
            }
        }
        let ends = |(start, size, name): (u64, u64, String)| (start, (start + size, rustc_demangled(&name)));
        let functions = functions(&fs::read(&program)?).into_iter().map(ends).collect();
        Ok(Symbols { base: base.unwrap_or(0), functions, libraries })
    }

    /// The function around this address of the running program, or the library; `?` for neither.
    pub fn name(&self, address: usize) -> &str {
        let address = address as u64;
        if let Some((.., name)) = self.libraries.iter().find(|(start, end, _)| (*start..*end).contains(&address)) {
            return name;
        }
        let Some(at) = address.checked_sub(self.base) else { return "?" };
        let before = self.functions.range(..=at).next_back();
        before.filter(|(_, (end, _))| at < *end).map_or("?", |(_, (_, name))| name)
    }
}

fn rustc_demangled(name: &str) -> String {
    format!("{:#}", rustc_demangle::demangle(name))
}
