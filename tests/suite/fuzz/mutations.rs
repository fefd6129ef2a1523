//! Changes of files that find faults in readers, drawn by a seeded generator.

use fastrand::Rng;

/// Longer files are cut.
const LONGEST: usize = 1 << 16;

/// Makes files from seeds and words.
pub(crate) struct Mutator {
    pub seeds: Vec<Vec<u8>>,
    /// The words of a dictionary.
    pub words: Vec<Vec<u8>>,
    random: Rng,
}

impl Mutator {
    pub(crate) fn new(seeds: Vec<Vec<u8>>, dictionary: &str, seed: u64) -> Mutator {
        assert!(!seeds.is_empty());
        Mutator { seeds, words: words(dictionary), random: Rng::with_seed(seed) }
    }

    /// A seed with one to eight changes.
    pub(crate) fn file(&mut self) -> Vec<u8> {
        let mut bytes = self.seed();
        for _ in 0..=self.random.usize(0..8) {
            self.change(&mut bytes);
            bytes.truncate(LONGEST);
        }
        bytes
    }

    fn seed(&mut self) -> Vec<u8> {
        let number = self.random.usize(0..self.seeds.len());
        self.seeds[number].clone()
    }

    fn word(&mut self) -> Vec<u8> {
        let number = self.random.usize(0..self.words.len());
        self.words[number].clone()
    }

    fn change(&mut self, bytes: &mut Vec<u8>) {
        let at = self.random.usize(0..=bytes.len());
        match self.random.u32(0..16) {
            0 => bytes.truncate(at),
            1 => self.splice(bytes, at),
            2..=4 => drop(bytes.splice(at..at, self.word())),
            5 | 6 => self.replace_number(bytes, at),
            7 => self.replace_line(bytes, at),
            8 => self.repeat_line(bytes, at),
            9 => self.overwrite(bytes, at),
            10 => {
                let end = (at + self.random.usize(0..32)).min(bytes.len());
                bytes.drain(at..end);
            }
            11 => {
                let end = (at + self.random.usize(0..64)).min(bytes.len());
                let copy = bytes[at..end].repeat(1 << self.random.u32(0..8));
                bytes.splice(at..at, copy);
            }
            12 => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte = self.random.u8(..);
                }
            }
            _ => {
                if let Some(byte) = bytes.get_mut(at) {
                    *byte ^= 1 << self.random.u32(0..8);
                }
            }
        }
    }

    /// Goes on as another seed does.
    fn splice(&mut self, bytes: &mut Vec<u8>, at: usize) {
        let other = self.seed();
        let from = self.random.usize(0..=other.len());
        bytes.truncate(at);
        bytes.extend_from_slice(&other[from..]);
    }

    /// Puts a word for the next number in a text.
    fn replace_number(&mut self, bytes: &mut Vec<u8>, at: usize) {
        let is_part = |byte: &u8| byte.is_ascii_digit() || b"+-.eE".contains(byte);
        let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit).map(|n| at + n) else {
            return;
        };
        let end =
            bytes[start..].iter().position(|b| !is_part(b)).map_or(bytes.len(), |n| start + n);
        let number = match self.random.u32(0..4) {
            0 => self.random.i32(-9..10).to_string().into_bytes(),
            1 => self.random.i64(..).to_string().into_bytes(),
            2 => f32::from_bits(self.random.u32(..)).to_string().into_bytes(),
            _ => self.word(),
        };
        bytes.splice(start..end, number);
    }

    /// Puts a word for a line.
    fn replace_line(&mut self, bytes: &mut Vec<u8>, at: usize) {
        bytes.splice(line(bytes, at), self.word());
    }

    /// Puts a line there up to 2048 times more.
    fn repeat_line(&mut self, bytes: &mut Vec<u8>, at: usize) {
        let line = line(bytes, at);
        let copies = [&bytes[line.clone()], b"\n"].concat().repeat(1 << self.random.u32(0..12));
        bytes.splice(line.start..line.start, copies);
    }

    /// Puts a binary number there.
    fn overwrite(&mut self, bytes: &mut [u8], at: usize) {
        const TELLING: [u64; 12] = [
            0,
            1,
            0x7f,
            0xff,
            0x7fff,
            0xffff,
            0x7fff_ffff,
            0xffff_ffff,
            0x7fff_ffff_ffff_ffff,
            u64::MAX,
            0x7fc0_0000,
            0x7f7f_ffff,
        ];
        let number = TELLING[self.random.usize(0..TELLING.len())];
        let count = 1 << self.random.u32(0..4);
        let (little, big) = (number.to_le_bytes(), number.to_be_bytes());
        let number = if self.random.bool() { &little[..count] } else { &big[8 - count..] };
        bytes[at..].iter_mut().zip(number).for_each(|(byte, &new)| *byte = new);
    }
}

/// The line at a place, without its end.
fn line(bytes: &[u8], at: usize) -> std::ops::Range<usize> {
    let start = bytes[..at].iter().rposition(|&b| b == b'\n').map_or(0, |before| before + 1);
    let end = bytes[at..].iter().position(|&b| b == b'\n').map_or(bytes.len(), |n| at + n);
    start..end
}

/// The words of a dictionary in the form that AFL++ reads: one in quotes per line, with `\\`, `\"` and `\xNN`.
fn words(dictionary: &str) -> Vec<Vec<u8>> {
    dictionary.lines().filter(|line| line.starts_with('"')).map(word).collect()
}

fn word(line: &str) -> Vec<u8> {
    let quoted = line.strip_prefix('"').and_then(|line| line.strip_suffix('"')).expect("quotes");
    let mut bytes = quoted.bytes();
    let mut word = Vec::new();
    while let Some(byte) = bytes.next() {
        let escaped = if byte == b'\\' { bytes.next() } else { None };
        word.push(match escaped {
            None => byte,
            Some(b'x') => {
                let mut digit = || char::from(bytes.next().expect("two digits")).to_digit(16);
                let (high, low) = (digit().expect("hexadecimal"), digit().expect("hexadecimal"));
                (16 * high + low) as u8
            }
            Some(byte) => byte,
        });
    }
    word
}

#[test]
fn every_word_of_every_dictionary_is_read_as_it_is_meant() {
    assert_eq!(words("# A\n\"\\x0a\\\\ \\\"\"\n"), [b"\n\\ \""]);
    for target in &super::targets::TARGETS {
        let words = words(target.dictionary);
        assert!(words.len() > 10 && words.iter().all(|word| !word.is_empty()), "{}", target.name);
    }
}

#[test]
fn the_same_seed_makes_the_same_files_and_every_seed_is_used() {
    let mutator = |seed| Mutator::new(vec![b"a 1\nb 2\n".into(), b"c".into()], "\"d\"", seed);
    let files = |seed| {
        let mut mutator = mutator(seed);
        (0..1000).map(|_| mutator.file()).collect::<Vec<_>>()
    };
    assert_eq!(files(1), files(1));
    assert_ne!(files(1), files(2));
    for byte in *b"abcd" {
        assert!(files(1).iter().any(|file| file.contains(&byte)));
    }
}
