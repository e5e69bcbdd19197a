within HystId;
package Interfaces "Partial models: signals, signs and the balance of forces stand here, once"
end Interfaces;
