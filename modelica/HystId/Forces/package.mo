within HystId;
package Forces "Restoring-force laws with memory"
end Forces;
