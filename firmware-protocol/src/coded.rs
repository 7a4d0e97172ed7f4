//! Enums with a code on the wire.

/// Makes a fieldless enum with one wire code and one name per value.
macro_rules! coded {
    ($(#[$doc:meta])* $name:ident { $($(#[$value_doc:meta])* $value:ident = $code:literal $text:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name { $($(#[$value_doc])* $value,)* }

        impl $name {
            /// Every value.
            pub const ALL: &[Self] = &[$(Self::$value),*];

            /// The value with this code.
            pub(crate) fn from_code(code: u8) -> Option<Self> {
                match code { $($code => Some(Self::$value),)* _ => None }
            }

            /// Its code on the wire.
            pub fn code(self) -> u8 {
                match self { $(Self::$value => $code,)* }
            }

            /// Its name in files and on the screen.
            pub fn name(self) -> &'static str {
                match self { $(Self::$value => $text,)* }
            }
        }
    };
}
pub(crate) use coded;
