within HystId;
package Examples "Virtual experiments"
end Examples;
